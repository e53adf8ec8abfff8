// A mesh as a file.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "tools/files/mesh_file.hpp"

namespace tests {
namespace {

TEST(Mesh, PlyHoldsWhatTheMeshHolds) {
  rt::Startup startup;
  perception::Mesh m;
  m.vertices_W = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0.5F}};
  m.normals_W = {{0, 0, 1}, {0, 0, 1}, {0, 1, 0}};
  m.colours = {{1, 2, 3}, {4, 5, 6}, {7, 8, 255}};
  m.triangles = {{0, 1, 2}};
  const auto dir =
      std::filesystem::temp_directory_path() / ("teletact_ply_" + std::to_string(::getpid()));
  std::filesystem::create_directories(dir);
  const std::string path = (dir / "m.ply").string();
  ASSERT_TRUE(teletact::write_ply(startup.token(), path, m)) << "could not write";
  std::ifstream in(path, std::ios::binary);
  std::string line, header;
  while (std::getline(in, line)) {
    header += line + "\n";
    if (line == "end_header") break;
  }
  EXPECT_EQ(header.substr(0, 4), "ply\n");
  EXPECT_NE(header.find("format binary_little_endian 1.0"), std::string::npos);
  EXPECT_NE(header.find("element vertex 3"), std::string::npos);
  EXPECT_NE(header.find("element face 1"), std::string::npos);
  std::string body((std::istreambuf_iterator<char>(in)), {});
  ASSERT_EQ(body.size(), 3U * 27 + 13);
  float z;
  std::memcpy(&z, body.data() + 2 * 27 + 8, 4);
  EXPECT_EQ(z, 0.5F);
  EXPECT_EQ(static_cast<unsigned char>(body[2 * 27 + 26]), 255);
  std::int32_t last;
  std::memcpy(&last, body.data() + 81 + 9, 4);
  EXPECT_EQ(last, 2);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(dir), {}),
            1);  // nothing left beside it
  const auto bad = teletact::write_ply(startup.token(), (dir / "no" / "m.ply").string(), m);
  ASSERT_FALSE(bad.has_value());
  EXPECT_NE(bad.error().find("no/m.ply"), std::string::npos);
  m.colours.pop_back();
  EXPECT_FALSE(teletact::write_ply(startup.token(), path, m).has_value());
  std::filesystem::remove_all(dir);
}

}  // namespace
}  // namespace tests

// A floor and a hand on files, and teletact touch on them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "tools/files/csv.hpp"
#include "tools/teletact/commands.hpp"

namespace touch_files {

namespace fs = std::filesystem;

inline std::string npy_bytes(const std::vector<float>& v, const std::string& shape,
                             const std::string& descr = "<f4", const std::string& order = "False",
                             int major = 1) {
  std::string header =
      "{'descr': '" + descr + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }";
  while ((header.size() + (major == 1 ? 11U : 13U)) % 64 != 0) header += ' ';
  header += '\n';
  std::string out = "\x93NUMPY";
  out += static_cast<char>(major);
  out += '\0';
  out += static_cast<char>(header.size() & 0xffU);
  out += static_cast<char>(header.size() >> 8U);
  if (major > 1) out += std::string(2, '\0');
  out += header;
  out.append(reinterpret_cast<const char*>(v.data()), v.size() * sizeof(float));
  return out;
}

inline void write(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}
inline std::string read(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

class Touch : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = fs::path(testing::TempDir()) /
           (std::string("touch_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(dir_);
    fs::create_directories(dir_);
    write(dir_ / "floor.npy", floor(0.0F));
    write(dir_ / "hand.csv", press());
  }
  void TearDown() override { fs::remove_all(dir_); }

  // 24 x 24 x 24 nodes of 10 mm; the floor lies at z = 0.115 + height.
  static std::string floor(float height) {
    std::vector<float> v;
    for (int i = 0; i < 24 * 24; ++i) {
      for (int k = 0; k < 24; ++k) v.push_back(0.01F * static_cast<float>(k) - 0.115F - height);
    }
    return npy_bytes(v, "(24, 24, 24)");
  }
  // Down to 8 mm, 60 mm along x, and up, at 0.1 m/s; field origin (-0.1 + aside, 0.2, 0.3).
  static std::string press(double aside = 0) {
    std::ostringstream out;
    out << "t_s,x,y,z\n";
    char line[96];
    for (int i = 0; i < 1000; ++i) {
      const double z = i < 180 ? 0.01 - 1e-4 * i : i < 780 ? -0.008 : -0.008 + 1e-4 * (i - 780);
      const double x = i < 180 ? 0 : 1e-4 * std::min(600, i - 180);
      std::snprintf(line, sizeof line, "%.6f,%.9f,%.9f,%.9f\n", 1e-3 * i, aside - 0.01 + x, 0.31,
                    0.415 + z);
      out << line;
    }
    return out.str();
  }
  int run(std::vector<std::string> args) {
    args.insert(args.begin(), "touch");
    std::vector<char*> argv;
    for (auto& a : args) argv.push_back(a.data());
    return teletact::cmd_touch(static_cast<int>(argv.size()), argv.data());
  }
  std::vector<std::string> standard(const std::string& out = "trace.csv") {
    return {"--field",
            (dir_ / "floor.npy").string(),
            "--voxel",
            "0.01",
            "--origin=-0.1,0.2,0.3",
            "--path",
            (dir_ / "hand.csv").string(),
            "--method",
            "constrained",
            "--out",
            (dir_ / out).string()};
  }
  std::string refusal(const std::vector<std::string>& args) {
    try {
      run(args);
    } catch (const std::exception& e) {
      return e.what();
    }
    return "";
  }
  static std::vector<std::vector<double>> rows(const fs::path& path) {
    auto table = teletact::read_csv(path.string());
    if (!table) throw std::runtime_error(table.error());
    auto out = teletact::numeric_rows(table.value(), {"t_s", "hx", "hy", "hz", "px", "py", "pz",
                                                      "fx", "fy", "fz", "contacts", "cpu_ns"});
    if (!out) throw std::runtime_error(out.error());
    return out.value();
  }
  fs::path dir_;
};

}  // namespace touch_files

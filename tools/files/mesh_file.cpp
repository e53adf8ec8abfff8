#include "tools/files/mesh_file.hpp"

#include <unistd.h>

#include <bit>
#include <cerrno>
#include <cstdio>
#include <cstring>

namespace teletact {
namespace {

template <class T>
void append(std::string& out, const T& value) {
  static_assert(std::endian::native == std::endian::little);
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

std::string ply_bytes(const perception::Mesh& m) {
  std::string out = "ply\nformat binary_little_endian 1.0\nelement vertex " +
                    std::to_string(m.vertices_W.size()) +
                    "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n"
                    "property float ny\nproperty float nz\nproperty uchar red\n"
                    "property uchar green\nproperty uchar blue\nelement face " +
                    std::to_string(m.triangles.size()) +
                    "\nproperty list uchar int vertex_indices\nend_header\n";
  out.reserve(out.size() + m.vertices_W.size() * 27 + m.triangles.size() * 13);
  for (std::size_t i = 0; i < m.vertices_W.size(); ++i) {
    for (int a = 0; a < 3; ++a) append(out, m.vertices_W[i](a));
    for (int a = 0; a < 3; ++a) append(out, m.normals_W[i](a));
    append(out, m.colours[i].r), append(out, m.colours[i].g), append(out, m.colours[i].b);
  }
  for (const auto& t : m.triangles) {
    append(out, std::uint8_t{3});
    for (const std::uint32_t v : t) append(out, static_cast<std::int32_t>(v));
  }
  return out;
}

}  // namespace

rt::Result<bool> write_ply(rt::NonRealtime&, const std::string& path,
                           const perception::Mesh& mesh) {
  if (mesh.normals_W.size() != mesh.vertices_W.size() ||
      mesh.colours.size() != mesh.vertices_W.size())
    return rt::Error{path + ": the mesh has " + std::to_string(mesh.vertices_W.size()) +
                     " vertices but another number of normals or colours"};
  const std::string beside = path + ".tmp" + std::to_string(::getpid());
  const auto fail = [&](const char* what) {
    const std::string why = std::strerror(errno);
    std::remove(beside.c_str());
    return rt::Error{path + ": " + what + ": " + why};
  };
  std::FILE* f = std::fopen(beside.c_str(), "wb");
  if (f == nullptr) return fail("cannot create");
  const std::string bytes = ply_bytes(mesh);
  const bool written = std::fwrite(bytes.data(), 1, bytes.size(), f) == bytes.size() &&
                       std::fflush(f) == 0 && ::fsync(::fileno(f)) == 0;
  const bool closed = std::fclose(f) == 0;
  if (!written || !closed) return fail("cannot write");
  if (std::rename(beside.c_str(), path.c_str()) != 0) return fail("cannot rename");
  return true;
}

}  // namespace teletact

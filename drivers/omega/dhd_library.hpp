// Finds and loads the vendor's SDK at run time. Order of the search; the first file wins that loads
// and has every function the driver calls:
//   1  what the configuration names (device.omega.sdk), else the environment variable FORCEDIM_SDK:
//      a library file, or the SDK's folder (lib/release/<os>-<arch>-gcc, lib, or the folder itself;
//      in each libdhd.so.3, libdhd.so, libdhd.so.3.*)
//   2  libdhd.so.3     by the loader's own search
//   3  libdhd.so       the same
//   4  libdhd.so.3.*   newest first, in the usual library folders (the SDK's installer leaves only
//                      the full name there, without the links that the loader looks for)
// and then all of it for libdrd, which contains the same functions. The version must be 3.14 or a
// later 3.x. Set-up code only.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "drivers/omega/dhd_api.hpp"
#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"

namespace drivers {

struct DhdSearch {
  std::string named;  // device.omega.sdk; empty: the environment
  std::vector<std::string> folders{
      "/usr/local/lib", "/usr/local/lib64",        "/usr/lib",
      "/usr/lib64",     "/usr/lib/forcedimension", "/opt/forcedimension/lib"};
  bool loader = true;  // steps 2 and 3
};

struct DhdVersion {
  int major = 0, minor = 0, release = 0, revision = 0;
  [[nodiscard]] std::string text() const;
};

class DhdLibrary {
 public:
  DhdLibrary(const DhdLibrary&) = delete;
  DhdLibrary& operator=(const DhdLibrary&) = delete;
  ~DhdLibrary();

  // The error is one line: "SDK not found: tried ..." with every name, "SDK version ...", or which
  // function a file lacks.
  [[nodiscard]] static rt::Result<std::unique_ptr<DhdLibrary>> load(rt::NonRealtime&,
                                                                    const DhdSearch&);

  [[nodiscard]] const DhdApi& api() const noexcept { return api_; }
  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  [[nodiscard]] const DhdVersion& version() const noexcept { return version_; }
  // Another symbol of the library (the twin's controls); null: it has none of that name.
  [[nodiscard]] void* symbol(const char* name) const noexcept;

 private:
  DhdLibrary() = default;
  void* handle_ = nullptr;
  std::string path_;
  DhdVersion version_;
  DhdApi api_;
};

}  // namespace drivers

#include "drivers/omega/dhd_library.hpp"

#include <dlfcn.h>
#include <glob.h>
#include <sys/utsname.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <sstream>

namespace drivers {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> matches(const std::string& pattern) {
  std::vector<std::string> out;
  glob_t found{};
  if (::glob(pattern.c_str(), 0, nullptr, &found) == 0) {
    for (std::size_t i = 0; i < found.gl_pathc; ++i) out.emplace_back(found.gl_pathv[i]);
  }
  ::globfree(&found);
  return out;
}

std::vector<int> version_numbers(const std::string& path) {
  const auto at = path.rfind(".so.");
  std::vector<int> out;
  if (at == std::string::npos) return out;
  std::istringstream text(path.substr(at + 4));
  for (std::string part; std::getline(text, part, '.');) out.push_back(std::atoi(part.c_str()));
  return out;
}

// libdhd.so.3.* of a folder, newest version first.
std::vector<std::string> full_names(const std::string& folder, const std::string& base) {
  auto out = matches(folder + "/" + base + ".so.3.*");
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) {
    return version_numbers(a) > version_numbers(b);
  });
  return out;
}

// A line of the search: names to hand to the loader, and how it reads in "tried ...".
struct Candidates {
  std::vector<std::string> names;
  std::string tried;
};

void add_existing(Candidates& c, const std::string& name) {
  std::error_code ec;
  if (fs::exists(name, ec)) c.names.push_back(name);
}

Candidates in_folder(const std::string& folder, const std::string& base) {
  Candidates c;
  utsname machine{};
  ::uname(&machine);
  std::vector<std::string> places =
      matches(folder + "/lib/release/*-" + std::string(machine.machine) + "-gcc");
  places.push_back(folder + "/lib");
  places.push_back(folder);
  for (const auto& place : places) {
    add_existing(c, place + "/" + base + ".so.3");
    add_existing(c, place + "/" + base + ".so");
    for (auto& name : full_names(place, base)) c.names.push_back(name);
  }
  c.tried = folder + "/{lib/release/*-" + machine.machine + "-gcc,lib,.}/" + base + ".so{.3,,.3.*}";
  return c;
}

std::vector<Candidates> search_order(const DhdSearch& search) {
  std::vector<Candidates> out;
  std::string named = search.named;
  if (named.empty()) {
    const char* env = std::getenv("FORCEDIM_SDK");
    if (env != nullptr) named = env;
  }
  std::error_code ec;
  const bool is_folder = !named.empty() && fs::is_directory(named, ec);
  if (!named.empty() && !is_folder) {
    Candidates c;
    c.tried = named;
    add_existing(c, named);
    out.push_back(c);
  }
  for (const std::string base : {"libdhd", "libdrd"}) {
    if (is_folder) out.push_back(in_folder(named, base));
    if (search.loader) {
      out.push_back({{base + ".so.3"}, base + ".so.3"});
      out.push_back({{base + ".so"}, base + ".so"});
    }
    Candidates usual;
    for (const auto& folder : search.folders) {
      for (auto& name : full_names(folder, base)) usual.names.push_back(name);
      if (!usual.tried.empty()) usual.tried += ", ";
      usual.tried += folder + "/" + base + ".so.3.*";
    }
    out.push_back(usual);
  }
  return out;
}

// Resolves all functions; the name of the first that is missing, or empty.
std::string resolve(void* handle, DhdApi& api) {
  std::string missing;
  const auto get = [&](auto& function, const char* name) {
    using Function = std::remove_reference_t<decltype(function)>;
    function = reinterpret_cast<Function>(::dlsym(handle, name));
    if (function == nullptr && missing.empty()) missing = name;
  };
  get(api.get_sdk_version, "dhdGetSDKVersion");
  get(api.get_last_error, "dhdErrorGetLast");
  get(api.get_last_error_text, "dhdErrorGetLastStr");
  get(api.get_device_count, "dhdGetDeviceCount");
  get(api.open_type, "dhdOpenType");
  get(api.open_serial, "dhdOpenSerial");
  get(api.close, "dhdClose");
  get(api.stop, "dhdStop");
  get(api.get_system_type, "dhdGetSystemType");
  get(api.enable_expert_mode, "dhdEnableExpertMode");
  get(api.disable_expert_mode, "dhdDisableExpertMode");
  get(api.set_watchdog, "dhdSetWatchdog");
  get(api.get_watchdog, "dhdGetWatchdog");
  get(api.get_velocity_threshold, "dhdGetVelocityThreshold");
  get(api.set_time_guard, "dhdSetTimeGuard");
  get(api.set_max_force, "dhdSetMaxForce");
  get(api.set_gravity_compensation, "dhdSetGravityCompensation");
  get(api.get_effector_mass, "dhdGetEffectorMass");
  get(api.enable_force, "dhdEnableForce");
  get(api.get_position, "dhdGetPosition");
  get(api.set_force, "dhdSetForce");
  get(api.get_button_mask, "dhdGetButtonMask");
  get(api.get_status, "dhdGetStatus");
  return missing;
}

std::string loaded_from(const std::string& name, void* function) {
  Dl_info info{};
  if (::dladdr(function, &info) != 0 && info.dli_fname != nullptr) return info.dli_fname;
  return name;
}

}  // namespace

std::string DhdVersion::text() const {
  return std::to_string(major) + "." + std::to_string(minor) + "." + std::to_string(release) + "." +
         std::to_string(revision);
}

DhdLibrary::~DhdLibrary() {
  if (handle_ != nullptr) ::dlclose(handle_);
}

void* DhdLibrary::symbol(const char* name) const noexcept { return ::dlsym(handle_, name); }

rt::Result<std::unique_ptr<DhdLibrary>> DhdLibrary::load(rt::NonRealtime&,
                                                         const DhdSearch& search) {
  std::string tried, unfit, wrong;
  for (const Candidates& c : search_order(search)) {
    if (!c.tried.empty()) tried += (tried.empty() ? "" : ", ") + c.tried;
    for (const std::string& name : c.names) {
      std::unique_ptr<DhdLibrary> library(new DhdLibrary());
      library->handle_ = ::dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
      if (library->handle_ == nullptr) {
        // A bare name that the loader does not find is the ordinary case; a file that is there and
        // does not load (another processor, a missing dependency) is worth a word.
        if (name.find('/') != std::string::npos) unfit += "; " + std::string(::dlerror());
        continue;
      }
      if (const std::string missing = resolve(library->handle_, library->api_); !missing.empty()) {
        unfit += "; " + name + " lacks the function " + missing;
        continue;
      }
      auto& v = library->version_;
      library->api_.get_sdk_version(&v.major, &v.minor, &v.release, &v.revision);
      library->path_ = loaded_from(name, reinterpret_cast<void*>(library->api_.get_sdk_version));
      if (v.major != 3 || v.minor < 14) {
        // An old one in the way of the right one is passed over, and told of when there is no right
        // one.
        const std::string is = library->path_ + " is " + v.text();
        if (wrong.find(is) == std::string::npos) wrong += (wrong.empty() ? "" : ", ") + is;
        continue;
      }
      return library;
    }
  }
  if (!wrong.empty()) {
    return rt::Error{"wrong SDK version: " + wrong + ", needed is 3.14 or a later 3.x"};
  }
  return rt::Error{"SDK not found: tried " + tried + unfit};
}

}  // namespace drivers

// Each missing piece is one clear line; and the search for the SDK, step by step.
#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/utsname.h>

#include <filesystem>
#include <fstream>

#include "tests/unit/drivers_omega/twin_rig.hpp"

namespace {

using namespace twin_rig;
using drivers::DhdLibrary;
using drivers::DhdSearch;
using drivers::UsbScan;
namespace fs = std::filesystem;

struct Folder {
  fs::path path;
  Folder() {
    std::string name = (fs::temp_directory_path() / "teletact_sdk_XXXXXX").string();
    path = ::mkdtemp(name.data());
  }
  ~Folder() { fs::remove_all(path); }
  fs::path copy_twin(const fs::path& name) const {
    fs::create_directories((path / name).parent_path());
    // A copy: where a library stays loaded (sanitizers), it would answer for every link to it.
    fs::copy_file(kTwinLibrary, path / name);
    return path / name;
  }
};

struct Environment {
  explicit Environment(const std::string& value) { ::setenv("FORCEDIM_SDK", value.c_str(), 1); }
  ~Environment() { ::unsetenv("FORCEDIM_SDK"); }
};

void expect_one_line(const std::string& text) {
  EXPECT_EQ(text.find('\n'), std::string::npos) << text;
  EXPECT_LT(text.size(), 1500U) << text;
}

std::string refusal(TwinLibrary& twin, const OmegaConfig& config, const UsbScan& scan) {
  try {
    const OmegaDevice device(twin.token(), config, [&](auto) { return scan; });
  } catch (const std::runtime_error& e) {
    expect_one_line(e.what());
    return e.what();
  }
  return "opened";
}

std::string loaded(const DhdSearch& search) {
  rt::Startup startup;
  auto r = DhdLibrary::load(startup.token(), search);
  if (!r) {
    expect_one_line(r.error());
    return r.error();
  }
  return r.value()->path();
}

std::string machine() {
  utsname u{};
  ::uname(&u);
  return u.machine;
}

DhdSearch nowhere() {
  DhdSearch s;
  s.loader = false;
  s.folders.clear();
  return s;
}

TEST(OmegaRefusals, MissingSdkNamesEveryFileTried) {
  TwinLibrary twin;
  OmegaConfig c = quick_config();
  c.sdk = "/nonexistent/libdhd.so.3";
  const std::string said = refusal(twin, c, plugged());
  EXPECT_EQ(said.find("omega: SDK not found: tried /nonexistent/libdhd.so.3, libdhd.so.3, "), 0U)
      << said;
  for (const char* name :
       {"libdhd.so,", "/usr/local/lib/libdhd.so.3.*", "libdrd.so.3", "libdrd.so,"}) {
    EXPECT_NE(said.find(name), std::string::npos) << name << " in " << said;
  }
}

TEST(OmegaRefusals, WrongSdkVersion) {
  TwinLibrary twin;
  for (const auto& [major, minor, good] :
       {std::tuple{3, 13, false}, {2, 17, false}, {4, 0, false}, {3, 14, true}, {3, 99, true}}) {
    twin.set("version_major", major);
    twin.set("version_minor", minor);
    const std::string said = refusal(twin, quick_config(), plugged());
    if (good) {
      EXPECT_EQ(said, "opened");
    } else {
      EXPECT_EQ(said, "omega: wrong SDK version: " + kTwinLibrary + " is " + std::to_string(major) +
                          "." + std::to_string(minor) + ".0.0, needed is 3.14 or a later 3.x");
    }
  }
}

// An older SDK that comes first in the search does not hide the right one.
TEST(OmegaRefusals, WrongSdkVersionIsPassedOver) {
  rt::Startup startup;
  const Folder folder;
  const fs::path old = folder.copy_twin("lib/libdhd.so.3.99"),
                 right = folder.copy_twin("libdhd.so.3.14");
  DhdSearch first = nowhere();
  first.named = old.string();
  auto library = DhdLibrary::load(startup.token(), first);
  ASSERT_TRUE(library) << library.error();
  const auto control = drivers::find_twin_control(*library.value());  // kept loaded, it stays old
  ASSERT_EQ(control.set("version_minor", 13), 0);
  DhdSearch search = nowhere();
  search.named = folder.path.string();
  EXPECT_EQ(loaded(search), right.string());
  fs::remove(right);
  EXPECT_EQ(loaded(search),
            "wrong SDK version: " + old.string() + " is 3.13.0.0, needed is 3.14 or a later 3.x");
}

TEST(OmegaRefusals, NotPluggedIn) {
  TwinLibrary twin;
  twin.set("unplugged", 1);
  EXPECT_EQ(refusal(twin, quick_config(), {}),
            "omega: not plugged in: no USB device 1451:0402 or 1451:0301 is there");
}

TEST(OmegaRefusals, NoPermission) {
  TwinLibrary twin;
  twin.set("unplugged", 1);  // the SDK sees no device it may not open
  EXPECT_EQ(
      refusal(twin, quick_config(), plugged(-3))
          .find("omega: 1451:0402 (omega.x) on bus 1 device 4: no permission: udev rule missing; "
                "copy config/system/udev/70-teletact-haptic.rules to /etc/udev/rules.d/"),
      0U);
}

TEST(OmegaRefusals, NoUsbAtAll) {
  TwinLibrary twin;
  twin.set("unplugged", 1);
  UsbScan scan;
  scan.failure = "Entity not found";
  EXPECT_EQ(refusal(twin, quick_config(), scan),
            "omega: USB can not be read on this machine: Entity not found");
}

TEST(OmegaRefusals, BusyInTheSdkOrOnTheBus) {
  TwinLibrary twin;
  twin.set("busy", 1);
  EXPECT_EQ(refusal(twin, quick_config(), plugged()),
            "omega: an Omega.3 can not be opened; the SDK says: controller busy (error 3)");
  EXPECT_EQ(refusal(twin, quick_config(), plugged(-6)),
            "omega: 1451:0402 (omega.x) on bus 1 device 4: busy: another program holds it");
}

TEST(OmegaRefusals, AnotherSerialNumber) {
  TwinLibrary twin;
  OmegaConfig c = quick_config();
  c.serial = 7;
  EXPECT_EQ(refusal(twin, c, plugged()).find("omega: serial number 7 can not be opened"), 0U);
  c.serial = 1;
  EXPECT_EQ(refusal(twin, c, plugged()), "opened");
}

TEST(OmegaRefusals, AnotherDeviceType) {
  TwinLibrary twin;
  twin.set("system_type", 34);
  EXPECT_EQ(refusal(twin, quick_config(), plugged()),
            "omega: the device is of type 34, not an Omega.3 (33)");
  EXPECT_EQ(twin.get("open"), 0);
}

TEST(OmegaRefusals, FirmwareWithoutWatchdog) {
  TwinLibrary twin;
  twin.set("no_watchdog", 1);
  EXPECT_EQ(refusal(twin, quick_config(), plugged())
                .find("omega: the controller does not take a watchdog of 0.020000 s"),
            0U);
  EXPECT_EQ(twin.get("open"), 0);
}

TEST(OmegaRefusals, VelocityThresholdOff) {
  TwinLibrary twin;
  twin.set("velocity_threshold", 0);
  EXPECT_EQ(refusal(twin, quick_config(), plugged())
                .find("omega: the velocity threshold is off (another program set it to 0)"),
            0U);
}

TEST(OmegaRefusals, ArmHeavierThanTheLimit) {
  TwinLibrary twin("manual_clock = true\n[twin]\ngravity_mass_kg = 2\n");
  EXPECT_NE(refusal(twin, quick_config(), plugged()).find("leaves nothing of force_limit_N"),
            std::string::npos);
}

// ---- the bus

TEST(UsbVerdict, TheBestOfWhatIsThereDecides) {
  const auto ids = std::span<const drivers::UsbId>(OmegaDevice::kUsbIds);
  UsbScan scan = plugged(-3);
  scan.devices.push_back({0x1451, 0x0301, 2, 9, 0});
  EXPECT_EQ(judge(scan, ids, "r").presence, drivers::UsbPresence::kUsable);
  scan.devices.back().open_error = -6;
  EXPECT_EQ(judge(scan, ids, "r").presence, drivers::UsbPresence::kNoPermission);
  scan.devices.front() = {0x0403, 0x6001, 1, 2, 0};  // another FTDI adapter is no Falcon
  scan.devices.pop_back();
  EXPECT_EQ(judge(scan, ids, "r").presence, drivers::UsbPresence::kAbsent);
  scan.devices.push_back({0x1451, 0x0402, 1, 2, -4});  // gone while we looked
  EXPECT_EQ(judge(scan, ids, "r").presence, drivers::UsbPresence::kAbsent);
}

// ---- the search, one step at a time

TEST(SdkSearch, FileNamedByConfigurationOrEnvironment) {
  const Folder folder;
  const auto file = folder.copy_twin("any_name.so");
  DhdSearch s = nowhere();
  s.named = file;
  EXPECT_EQ(loaded(s), file.string());
  s.named.clear();
  const Environment env(file);
  EXPECT_EQ(loaded(s), file.string());
}

TEST(SdkSearch, FolderOfTheSdk) {
  for (const std::string& name :
       {"lib/release/lin-" + machine() + "-gcc/libdhd.so.3.17.5", std::string("lib/libdhd.so"),
        std::string("libdhd.so.3"), std::string("lib/libdrd.so.3.14.0")}) {
    const Folder folder;
    const auto file = folder.copy_twin(name);
    DhdSearch s = nowhere();
    const Environment env(folder.path);
    EXPECT_EQ(loaded(s), file.string());
  }
}

TEST(SdkSearch, ConfigurationGoesBeforeTheEnvironment) {
  const Folder a, b;
  const auto wanted = a.copy_twin("libdhd.so.3");
  (void)b.copy_twin("libdhd.so.3");
  const Environment env(b.path);
  DhdSearch s = nowhere();
  s.named = a.path;
  EXPECT_EQ(loaded(s), wanted.string());
}

TEST(SdkSearch, FullNameInTheUsualFoldersNewestFirst) {
  const Folder folder;
  (void)folder.copy_twin("libdhd.so.3.9.2");
  (void)folder.copy_twin("libdhd.so.3.17.5");
  const auto newest = folder.copy_twin("libdhd.so.3.17.12");
  DhdSearch s = nowhere();
  s.folders = {folder.path.string()};
  EXPECT_EQ(loaded(s), newest.string());
}

TEST(SdkSearch, DhdGoesBeforeDrd) {
  const Folder folder;
  (void)folder.copy_twin("libdrd.so.3.17.5");
  const auto dhd = folder.copy_twin("libdhd.so.3.14.0");
  DhdSearch s = nowhere();
  s.folders = {folder.path.string()};
  EXPECT_EQ(loaded(s), dhd.string());
}

TEST(SdkSearch, AFileThatDoesNotLoadIsNamedAndPassedOver) {
  const Folder folder;
  std::ofstream(folder.path / "libdhd.so.3") << "not a library";
  DhdSearch s = nowhere();
  s.named = folder.path;
  const std::string said = loaded(s);
  EXPECT_EQ(said.find("SDK not found: tried "), 0U) << said;
  EXPECT_NE(said.find("libdhd.so.3: "), std::string::npos) << said;
  const auto good = folder.copy_twin("libdhd.so");
  EXPECT_EQ(loaded(s), good.string());
}

TEST(SdkSearch, ALibraryWithoutTheFunctionsIsNamed) {
  const Folder folder;
  // The C library's own mathematics: a good shared object, and no SDK.
  std::string libm;
  for (const char* place : {"/lib", "/usr/lib", "/lib64", "/usr/lib64"}) {
    const std::string candidate = std::string(place) + "/" + machine() + "-linux-gnu/libm.so.6";
    if (fs::exists(candidate)) libm = candidate;
  }
  if (libm.empty()) GTEST_SKIP() << "no libm.so.6 in the usual places";
  fs::create_symlink(libm, folder.path / "libdhd.so.3");
  DhdSearch s = nowhere();
  s.named = folder.path;
  EXPECT_NE(loaded(s).find("libdhd.so.3 lacks the function dhdGetSDKVersion"), std::string::npos);
}

TEST(TwinLibraryFile, BadTextIsOneLine) {
  TwinLibrary twin;
  EXPECT_EQ(twin.control().reset("[twin]\nmass_kg = -1\n"), -1);
  expect_one_line(twin.control().error());
  EXPECT_NE(std::string(twin.control().error()).find("mass_kg"), std::string::npos);
  EXPECT_EQ(twin.control().set("no_such_key", 1), -1);
  EXPECT_TRUE(std::isnan(twin.control().get("no_such_key")));
}

}  // namespace

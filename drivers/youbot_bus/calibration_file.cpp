#include "drivers/youbot_bus/calibration_file.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <fstream>

#include "config/schema.hpp"
#include "drivers/youbot_bus/youbot_setup.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr int kCalibrationVersion = 1;
constexpr std::size_t kMostCalibrationBytes = 1U << 16U;
constexpr std::string_view kCheckMark = "# check ";
constexpr std::size_t kCheckLine = kCheckMark.size() + 9;  // eight digits and the line's end
constexpr int kMostStop_mA = 20000;                        // of axis parameter 6

// CRC-32 as in Ethernet.
std::uint32_t check_of(std::string_view text) noexcept {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char c : text) {
    crc ^= static_cast<std::uint8_t>(c);
    for (int b = 0; b < 8; ++b) crc = crc >> 1U ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
  }
  return ~crc;
}

std::string check_line(std::string_view content) {
  std::array<char, 32> line{};
  std::snprintf(line.data(), line.size(), "# check %08x\n", check_of(content));
  return line.data();
}

// From anywhere in its travel to the stop, and a fifth more.
std::int32_t most_offset(int joint) noexcept { return -joint_facts(joint).low_ticks / 5 * 6; }

bool is_day(const std::string& text) {
  if (text.size() != 10 || text[4] != '-' || text[7] != '-') return false;
  for (const std::size_t i : {0, 1, 2, 3, 5, 6, 8, 9})
    if (text[i] < '0' || text[i] > '9') return false;
  const int month = std::stoi(text.substr(5, 2)), day = std::stoi(text.substr(8, 2));
  return month >= 1 && month <= 12 && day >= 1 && day <= 31;
}

struct BoardLines {
  std::string name;
  std::uint64_t vendor = 0, product = 0, revision = 0, serial = 0;
  void describe(config::Section& s) {
    s.text("name", name, {}, "first string of the EEPROM");
    s.seed("vendor", vendor, "of the EEPROM");
    s.seed("product", product, "of the EEPROM");
    s.seed("revision", revision, "of the EEPROM");
    s.seed("serial", serial, "of the EEPROM");
  }
  [[nodiscard]] bool fits() const {
    return std::max({vendor, product, revision, serial}) <= 0xFFFFFFFFULL;
  }
  [[nodiscard]] BoardIdentity identity() const {
    const auto word = [](std::uint64_t v) { return static_cast<std::uint32_t>(v); };
    return {name, word(vendor), word(product), word(revision), word(serial)};
  }
};

struct CalibrationLines {
  int version = kCalibrationVersion;
  std::string date, chain = "base+arm";
  std::deque<BoardLines> boards;
  std::deque<HomedJoint> joints;

  void describe(config::Section& s) {
    s.integer("version", version, kCalibrationVersion, kCalibrationVersion, "of this format");
    s.text("date", date, {}, "day of the homing, UTC");
    s.text("chain", chain, {"base+arm", "base+2arms", "arm"}, "which youBot");
    s.list(
        "board", [this](config::Section& item) { boards.emplace_back().describe(item); },
        "slaves by position");
    s.list(
        "joint", [this](config::Section& item) { describe_joint(joints.emplace_back(), item); },
        "what homing measured");
  }
  static void describe_joint(HomedJoint& j, config::Section& s) {
    s.integer("arm", j.arm, 1, 2, "of a robot with two");
    s.integer("joint", j.joint, 1, 5, "from the base");
    s.integer("offset_ticks", j.offset_ticks, -most_offset(1), most_offset(1), "count at the stop");
    s.integer("direction", j.direction, 1, 1, "raw direction of the stop");
    s.integer("stop_mA", j.stop_mA, -kMostStop_mA, kMostStop_mA, "current at the stop");
  }
};

std::string boards_wrong(const Calibration& c) {
  const auto places = boards_of(c.chain);
  if (c.boards.size() != places.size())
    return "key 'board' stands there " + std::to_string(c.boards.size()) + " times: allowed " +
           std::to_string(places.size()) + ", the slaves of " + to_text(c.chain);
  for (std::size_t i = 0; i < places.size(); ++i)
    if (!fits(places[i], c.boards[i].name))
      return "key 'board[" + std::to_string(i) + "].name' = \"" + c.boards[i].name +
             "\": no board of a " + places[i].name();
  return {};
}

std::string joints_wrong(const Calibration& c) {
  std::vector<BoardPlace> wanted;
  for (const BoardPlace& b : boards_of(c.chain))
    if (b.kind == BoardKind::kJoint) wanted.push_back(b);
  if (c.joints.size() != wanted.size())
    return "key 'joint' stands there " + std::to_string(c.joints.size()) + " times: allowed " +
           std::to_string(wanted.size()) + ", the joints of " + to_text(c.chain);
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const HomedJoint& j = c.joints[i];
    const std::string key = "key 'joint[" + std::to_string(i) + "]";
    if (j.arm != wanted[i].arm || j.joint != wanted[i].number)
      return key + "' is of arm " + std::to_string(j.arm) + " joint " + std::to_string(j.joint) +
             ": allowed " + wanted[i].name() + " at this place";
    const std::int32_t most = most_offset(j.joint);
    if (j.offset_ticks < -most || j.offset_ticks > most)
      return key + ".offset_ticks' = " + std::to_string(j.offset_ticks) + ": allowed " +
             std::to_string(-most) + ".." + std::to_string(most);
    if (j.direction != 1)
      return key + ".direction' = " + std::to_string(j.direction) +
             ": allowed 1: every joint of a youBot counts up to its stop";
    if (j.stop_mA < -kMostStop_mA || j.stop_mA > kMostStop_mA)
      return key + ".stop_mA' = " + std::to_string(j.stop_mA) + ": allowed " +
             std::to_string(-kMostStop_mA) + ".." + std::to_string(kMostStop_mA);
  }
  return {};
}

// Empty: the last line is the check of all before it.
std::string damage(const std::string& text) {
  if (text.size() > kMostCalibrationBytes)
    return std::to_string(text.size()) + " bytes: allowed 0.." +
           std::to_string(kMostCalibrationBytes);
  const std::string_view all = text;
  if (all.size() >= kCheckLine) {
    const auto content = all.substr(0, all.size() - kCheckLine);
    if ((content.empty() || content.back() == '\n') &&
        all.substr(content.size()) == check_line(content))
      return {};
  }
  return "damaged or changed by hand: its last line is not the check of its content; "
         "teletact youbot setup --calibration writes it anew";
}

}  // namespace

bool Calibration::has_serials() const noexcept {
  return std::any_of(boards.begin(), boards.end(), [](const auto& b) { return b.serial != 0; });
}

std::vector<BoardIdentity> identities(const std::vector<ethercat::SlaveInfo>& slaves) {
  std::vector<BoardIdentity> out;
  for (const ethercat::SlaveInfo& s : slaves)
    out.push_back({s.sii.name, s.sii.vendor, s.sii.product, s.sii.revision, s.sii.serial});
  return out;
}

std::string why_refused(const Calibration& c) {
  if (!is_day(c.date)) return "key 'date' is no day as 2026-01-31";
  if (c.chain == ChainKind::kBase) return "key 'chain': a base has no joints";
  const std::string boards = boards_wrong(c);
  return boards.empty() ? joints_wrong(c) : boards;
}

std::string with_check(std::string content) {
  content += check_line(content);
  return content;
}

std::string calibration_text(const Calibration& c) {
  std::string out =
      "# What homing measured, by teletact youbot setup. Not to be changed by hand.\n";
  out += "version = " + std::to_string(kCalibrationVersion) + "\ndate = \"" + c.date +
         "\"\nchain = \"" + to_text(c.chain) + "\"\n";
  std::array<char, 200> line{};
  for (const BoardIdentity& b : c.boards) {
    std::snprintf(line.data(), line.size(),
                  "\n[[board]]\nname = \"%.40s\"\nvendor = 0x%x\nproduct = 0x%x\nrevision = %u\n"
                  "serial = %u\n",
                  b.name.c_str(), b.vendor, b.product, b.revision, b.serial);
    out += line.data();
  }
  for (const HomedJoint& j : c.joints) {
    std::snprintf(line.data(), line.size(),
                  "\n[[joint]]\narm = %d\njoint = %d\noffset_ticks = %d\ndirection = %d\n"
                  "stop_mA = %d\n",
                  j.arm, j.joint, j.offset_ticks, j.direction, j.stop_mA);
    out += line.data();
  }
  return with_check(out);
}

rt::Result<Calibration> read_calibration(const std::string& text, const std::string& name) {
  if (const std::string bad = damage(text); !bad.empty()) return rt::Error{name + ": " + bad};
  CalibrationLines lines;
  config::Section schema;
  lines.describe(schema);
  if (const auto read = config::load_text(text, name, schema); !read)
    return rt::Error{read.error()};
  for (const char* key : {"version", "date", "chain"})
    if (!schema.named(key)) return rt::Error{name + ": key '" + key + "' is missing"};
  Calibration out;
  out.date = lines.date;
  out.chain = *chain_kind_of(lines.chain);
  for (const BoardLines& b : lines.boards) {
    if (!b.fits()) return rt::Error{name + ": key 'board' has a number beyond 4294967295"};
    out.boards.push_back(b.identity());
  }
  out.joints.assign(lines.joints.begin(), lines.joints.end());
  const std::string wrong = why_refused(out);
  if (!wrong.empty()) return rt::Error{name + ": " + wrong};
  return out;
}

rt::Result<Calibration> load_calibration(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored))
    return rt::Error{path + ": is a folder, not a file"};
  std::ifstream in(path, std::ios::binary);
  if (!in) return rt::Error{path + ": can not be opened for reading"};
  std::string text(kMostCalibrationBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (in.bad()) return rt::Error{path + ": can not be read"};
  text.resize(static_cast<std::size_t>(in.gcount()));
  return read_calibration(text, path);
}

std::string other_robot(const Calibration& c, const std::vector<ethercat::SlaveInfo>& slaves) {
  const auto here = identities(slaves);
  if (here.size() != c.boards.size())
    return "it is of a robot of " + std::to_string(c.boards.size()) + " slaves, this one has " +
           std::to_string(here.size());
  const auto told = [](const BoardIdentity& b) {
    std::array<char, 160> text{};
    std::snprintf(text.data(), text.size(), "'%.40s' product 0x%x revision %u serial %u",
                  b.name.c_str(), b.product, b.revision, b.serial);
    return std::string(text.data());
  };
  for (std::size_t i = 0; i < here.size(); ++i)
    if (here[i] != c.boards[i])
      return "it is another robot's: slave " + std::to_string(i + 1) + " is " + told(here[i]) +
             ", the file has " + told(c.boards[i]);
  return {};
}

}  // namespace drivers::youbot_bus

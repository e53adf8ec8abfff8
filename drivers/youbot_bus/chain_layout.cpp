#include "drivers/youbot_bus/chain_layout.hpp"

#include <algorithm>
#include <array>

#include "drivers/ethercat/served.hpp"
#include "drivers/youbot_bus/process_data.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr std::array<std::array<std::string_view, 2>, 4> kBoardNames{{
    {"KR-845", "KR-845"},          // base master board
    {"TMCM-174", "TMCM-1632"},     // wheel
    {"KR-843", "KR-845"},          // arm master board
    {"TMCM-KR-841", "TMCM-1610"},  // joint
}};
constexpr int kWheelBoards = 4, kJointBoards = 5;

const auto& names_of(BoardKind k) noexcept { return kBoardNames[static_cast<std::size_t>(k)]; }

std::string wanted_names(const BoardPlace& b) {
  const auto& n = names_of(b.kind);
  std::string out = "'" + std::string(n[0]) + "'";
  if (n[1] != n[0]) out += " or '" + std::string(n[1]) + "'";
  return out;
}

void add_arm(std::vector<BoardPlace>& to, int arm) {
  to.push_back({BoardKind::kArmMaster, 0, arm});
  for (int j = 1; j <= kJointBoards; ++j) to.push_back({BoardKind::kJoint, j, arm});
}

// A board that the table of the public youBot driver's master has (its ethercatconfiglist.h), and
// its motor code has not. Empty: another one.
std::string listed_board(const ethercat::SlaveInfo& s, const ethercat::SlaveMapping& m) {
  constexpr std::size_t kBytes = 40;
  constexpr std::uint32_t kProduct = 0x11;
  if (s.sii.product != kProduct || m.output_bytes != kBytes || m.input_bytes != kBytes) return {};
  return "product code 0x11 with 40 bytes each way: what stands in them is not published, so this "
         "board is not driven";
}

// Empty: a youBot drive's.
std::string drive_problem(const ethercat::SlaveMapping& m) {
  if (m.output_bytes != kOutputBytes)
    return std::to_string(m.output_bytes) + " bytes of outputs, a drive has 5";
  if (!known_input_size(m.input_bytes))
    return std::to_string(m.input_bytes) + " bytes of inputs, a drive has 16, 18, 20 or 32";
  if (!m.mailbox.usable()) return "no mailbox, a drive has one";
  return {};
}

}  // namespace

const char* to_text(ChainKind k) noexcept {
  static constexpr std::array kTexts{"base", "base+arm", "base+2arms", "arm"};
  return kTexts[static_cast<std::size_t>(k)];
}

std::optional<ChainKind> chain_kind_of(std::string_view text) noexcept {
  for (const ChainKind k : kChainKinds)
    if (text == to_text(k)) return k;
  return std::nullopt;
}

std::string BoardPlace::name() const {
  static constexpr std::array kWheelNames{"front left", "front right", "back left", "back right"};
  const std::string of_arm = "arm " + std::to_string(arm);
  switch (kind) {
    case BoardKind::kBaseMaster:
      return "base master board";
    case BoardKind::kWheel:
      return std::string("wheel ") + kWheelNames[static_cast<std::size_t>(number)];
    case BoardKind::kArmMaster:
      return of_arm + " master board";
    case BoardKind::kJoint:
      return of_arm + " joint " + std::to_string(number);
  }
  return {};
}

std::vector<BoardPlace> boards_of(ChainKind kind) {
  std::vector<BoardPlace> out;
  if (kind != ChainKind::kArm) {
    out.push_back({BoardKind::kBaseMaster, 0, 0});
    for (int w = 0; w < kWheelBoards; ++w) out.push_back({BoardKind::kWheel, w, 0});
  }
  if (kind != ChainKind::kBase) add_arm(out, 1);
  if (kind == ChainKind::kBaseTwoArms) add_arm(out, 2);
  return out;
}

bool fits(const BoardPlace& b, std::string_view name) noexcept {
  const auto& n = names_of(b.kind);
  return name == n[0] || name == n[1];
}

std::optional<ChainKind> find_chain(const std::vector<ethercat::SlaveInfo>& slaves) {
  for (const ChainKind k : kChainKinds) {
    const auto boards = boards_of(k);
    if (boards.size() != slaves.size()) continue;
    if (std::equal(
            boards.begin(), boards.end(), slaves.begin(),
            [](const BoardPlace& b, const ethercat::SlaveInfo& s) { return fits(b, s.sii.name); }))
      return k;
  }
  return std::nullopt;
}

std::string missing_text(std::size_t there, std::size_t wanted) {
  if (there >= wanted) return {};
  const std::string which = there + 1 == wanted ? "slave " + std::to_string(wanted) + " is missing"
                                                : "slaves " + std::to_string(there + 1) + " to " +
                                                      std::to_string(wanted) + " are missing";
  if (there == 0)
    return "no slave answers: look at the cable to the first one, and whether the robot has power";
  return which + ": look at the cable behind " + std::to_string(there) +
         ", or at the emergency stop";
}

std::string missing_boards(ChainKind kind, const std::vector<ethercat::SlaveInfo>& slaves) {
  const auto boards = boards_of(kind);
  if (slaves.size() >= boards.size()) return {};
  for (std::size_t i = 0; i < slaves.size(); ++i)
    if (!fits(boards[i], slaves[i].sii.name)) return {};
  return missing_text(slaves.size(), boards.size()) + " (slave " +
         std::to_string(slaves.size() + 1) + ": " + boards[slaves.size()].name() + ")";
}

std::vector<std::string> check_chain(ChainKind kind,
                                     const std::vector<ethercat::SlaveInfo>& slaves) {
  std::vector<std::string> out;
  const auto boards = boards_of(kind);
  auto judged = slaves;
  const ethercat::ServedChain served = ethercat::map_served(judged);
  const auto odd = [&](std::size_t i) { return i < judged.size() && !judged[i].problem.empty(); };
  for (std::size_t i = 0; i < std::max(boards.size(), slaves.size()); ++i) {
    const std::string slave = "slave " + std::to_string(i + 1) + ": ";
    if (i >= slaves.size()) {
      out.push_back(slave + boards[i].name() + " (" + wanted_names(boards[i]) + ") is missing");
    } else if (odd(i)) {
      out.push_back(judged[i].problem);
    } else if (const auto listed = listed_board(judged[i], served.mapping.slaves[i]);
               !listed.empty()) {
      out.push_back(slave + listed);
    } else if (i >= boards.size()) {
      out.push_back(slave + "'" + slaves[i].sii.name + "' is one too many");
    } else if (!fits(boards[i], slaves[i].sii.name)) {
      out.push_back(slave + "'" + slaves[i].sii.name + "' where " + boards[i].name() + " (" +
                    wanted_names(boards[i]) + ") belongs");
    } else if (boards[i].is_drive()) {
      const std::string wrong = drive_problem(served.mapping.slaves[i]);
      if (!wrong.empty()) out.push_back(slave + boards[i].name() + ": " + wrong);
    }
  }
  if (out.empty() && !served.problem.empty()) out.push_back(served.problem);
  return out;
}

}  // namespace drivers::youbot_bus

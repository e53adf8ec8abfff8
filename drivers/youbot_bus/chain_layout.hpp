// Which boards a youBot has on its bus, and what is wrong with a chain that was found.
//
// Boards are known by the first string of their SII, as the youBot's own driver has it; product
// codes are not published. Both hardware generations: wheels TMCM-174 or TMCM-1632, arm joints
// TMCM-KR-841 or TMCM-1610, master boards KR-845 (base) and KR-843 or KR-845 (arm).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/ethercat/slave_info.hpp"

namespace drivers::youbot_bus {

enum class ChainKind : std::uint8_t { kBase, kBaseArm, kBaseTwoArms, kArm };
inline constexpr std::array kChainKinds{ChainKind::kBase, ChainKind::kBaseArm,
                                        ChainKind::kBaseTwoArms, ChainKind::kArm};
// "base", "base+arm", "base+2arms", "arm".
[[nodiscard]] const char* to_text(ChainKind) noexcept;
[[nodiscard]] std::optional<ChainKind> chain_kind_of(std::string_view text) noexcept;

enum class BoardKind : std::uint8_t { kBaseMaster, kWheel, kArmMaster, kJoint };

struct BoardPlace {
  BoardKind kind = BoardKind::kBaseMaster;
  int number = 0;  // wheel 0 to 3 (front left, front right, back left, back right); joint 1 to 5
  int arm = 0;     // of a joint or an arm's master board: 1 or 2
  [[nodiscard]] bool is_drive() const noexcept {
    return kind == BoardKind::kWheel || kind == BoardKind::kJoint;
  }
  // "wheel front left", "arm 2 joint 5".
  [[nodiscard]] std::string name() const;
};

// By position on the bus.
[[nodiscard]] std::vector<BoardPlace> boards_of(ChainKind);
// Does a board of this name belong there?
[[nodiscard]] bool fits(const BoardPlace&, std::string_view sii_name) noexcept;

// The kind of chain that was found, nullopt: none of them.
[[nodiscard]] std::optional<ChainKind> find_chain(const std::vector<ethercat::SlaveInfo>&);

// "slaves 7 to 11 are missing: look at the cable behind 6, or at the emergency stop", where the
// boards that answer are the first ones of this chain and others should follow; empty: they are
// not. Of no board at all it says that none answers.
[[nodiscard]] std::string missing_boards(ChainKind, const std::vector<ethercat::SlaveInfo>&);
[[nodiscard]] std::string missing_text(std::size_t there, std::size_t wanted);

// A line for each slave that is wrong, missing or too many, and for each drive whose process data
// or mailbox is not a youBot's. Empty: the chain is that.
[[nodiscard]] std::vector<std::string> check_chain(ChainKind,
                                                   const std::vector<ethercat::SlaveInfo>&);

}  // namespace drivers::youbot_bus

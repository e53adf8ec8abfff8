// The virtual youBot's bus: 5, 6, 11 or 17 slaves in the order of the real ones, with their
// EEPROMs. What is not published (product codes, addresses of mailboxes and process data) is this
// program's choice, and a setting: a master has to read it from the EEPROM.
#pragma once

#include <functional>
#include <vector>

#include "drivers/ethercat/twin/chain.hpp"
#include "drivers/youbot_bus/chain_layout.hpp"
#include "drivers/youbot_bus/twin/drive_board.hpp"
#include "drivers/youbot_bus/twin/motor_effects.hpp"

namespace drivers::youbot_bus {

enum class Generation : std::uint8_t {
  kOld,  // TMCM-174, TMCM-KR-841, KR-843; firmware 1.48
  kNew   // TMCM-1632, TMCM-1610, KR-845; firmware 2.00
};

struct YoubotChainConfig {
  ChainKind kind = ChainKind::kBaseArm;
  Generation generation = Generation::kNew;
  std::size_t input_bytes = 0;  // 16, 18, 20, 32; 0: as the firmware has it (20 or 32)
  std::uint16_t mailbox_start = 0x1000, mailbox_bytes = 128;
  std::uint16_t outputs_start = 0x1100, inputs_start = 0x1400;
  bool data_watchdog = true;  // control of the outputs' sync manager 0x64, else 0x24
  bool forbids_lrw = false;   // a flag of the general category
  bool initialised = false;   // commutation known at power-up
  // Effect: the joints' own motors have ends of travel, and stand within it at power-up.
  bool end_stops = false;
  // Of the chain's own motors: friction, weight and more; none of them: ideal motors.
  MotorEffects effects;
  std::uint32_t first_serial = 1;  // in the EEPROM of the first board, one more in each behind it
  ethercat::EscConfig esc;
};

class YoubotChain {
 public:
  // `motor` is asked for the motor of each drive; empty: the chain's own.
  using MotorMaker = std::function<std::unique_ptr<DriveMotor>(const BoardPlace&)>;
  YoubotChain(rt::NonRealtime&, const YoubotChainConfig&, const MotorMaker& motor = {});

  [[nodiscard]] ethercat::TwinChain& wire() noexcept { return chain_; }
  [[nodiscard]] const std::vector<BoardPlace>& boards() const noexcept { return boards_; }
  // Of the slave at this position; nullptr: a master board.
  [[nodiscard]] DriveBoard* drive(std::size_t position) noexcept { return drives_[position]; }

  // ---- faults
  // The emergency stop of the platform takes the power of its drives and of what lies behind; of an
  // arm alone, of its joints. What is left answers.
  void emergency_stop() noexcept;
  // Power is back: the boards begin anew.
  void release_emergency_stop(rt::Time now) noexcept;

 private:
  ethercat::TwinChain chain_;
  std::vector<BoardPlace> boards_;
  std::vector<DriveBoard*> drives_;
};

// The EEPROM of one board.
[[nodiscard]] std::vector<std::uint8_t> youbot_eeprom(const BoardPlace&, const YoubotChainConfig&,
                                                      std::uint32_t serial);

}  // namespace drivers::youbot_bus

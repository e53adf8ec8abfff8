// A youBot's chain in OP for set-up and bench: cycles at a pace, TMCL requests while they run,
// and a command for each drive. Ordinary thread: it waits and allocates.
//
// A reply that is lost, empty or odd, and a reading that is refused, is asked for again: boards of
// firmware 1.48 give zeros at first. At most kMostAsks times, and kSilence for a mailbox that says
// nothing; such a board is not asked again in this session. A movement is never asked for twice.
//
// Every command is motor stop until it is set. A bus that is bad for `bad_limit` cycles in a row
// ends the session: the master sends zeros from then on, and failed() says why.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "drivers/ethercat/master.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/youbot_bus/chain_layout.hpp"
#include "drivers/youbot_bus/process_data.hpp"
#include "rt/result.hpp"

namespace drivers::youbot_bus {

class DriveSession {
 public:
  // `master` is in OP.
  DriveSession(rt::NonRealtime&, ethercat::Master& master, ethercat::Port& port, ChainKind kind);

  [[nodiscard]] const std::vector<BoardPlace>& boards() const noexcept { return boards_; }
  // Positions on the bus.
  [[nodiscard]] std::vector<std::size_t> drives() const;
  [[nodiscard]] std::vector<std::size_t> joints(int arm) const;

  // One cycle of 1 ms. False: the bus has failed.
  bool cycle();
  // As long as it is not `done`, at most so many cycles. False: not done, or the bus has failed.
  bool cycle_until(int most, const std::function<bool()>& done);
  void set(std::size_t position, const DriveOutputs&);
  [[nodiscard]] DriveOutputs command(std::size_t position) const;
  void stop_all();
  [[nodiscard]] DriveInputs inputs(std::size_t position) const;
  [[nodiscard]] std::size_t input_bytes(std::size_t position) const {
    return master_.inputs(position).size();
  }
  // TMCL through the mailbox while cycles run. The error names the board and what it said.
  [[nodiscard]] rt::Result<std::int32_t> ask(std::size_t position, const tmcl::Request&,
                                             int most_asks = kMostAsks);
  [[nodiscard]] rt::Result<std::int32_t> get(std::size_t position, std::uint8_t parameter);
  [[nodiscard]] rt::Result<bool> put(std::size_t position, std::uint8_t parameter,
                                     std::int32_t value);
  [[nodiscard]] rt::Result<tmcl::Firmware> firmware(std::size_t position);
  // Of the gripper behind a joint 5.
  [[nodiscard]] rt::Result<tmcl::Firmware> gripper_firmware(std::size_t position);
  [[nodiscard]] rt::Time now() const noexcept { return port_.now(); }
  // Its mailbox has been silent for kSilence.
  [[nodiscard]] bool is_silent(std::size_t position) const { return silent_[position]; }
  // Empty: it has not.
  [[nodiscard]] std::string failed() const;
  [[nodiscard]] std::string name(std::size_t position) const { return boards_[position].name(); }

  static constexpr int kMostAsks = 50;
  static constexpr rt::Nanos kSilence = std::chrono::seconds{5};

 private:
  using Bytes = std::span<const std::uint8_t>;
  // Of a reply: empty, or why it is none.
  using Judge = std::function<std::string(Bytes reply)>;
  [[nodiscard]] rt::Result<bool> ask_until(std::size_t position, const tmcl::Request&,
                                           int most_asks, const Judge&);
  [[nodiscard]] rt::Result<tmcl::Firmware> version(std::size_t position, std::uint8_t module);
  // False: no reply.
  [[nodiscard]] bool transfer(std::size_t position, const tmcl::Request&);
  void throw_late_replies_away(std::size_t position);
  rt::NonRealtime& nrt_;
  ethercat::Master& master_;
  ethercat::Port& port_;
  std::vector<BoardPlace> boards_;
  std::vector<bool> silent_;  // by position
  rt::Time next_;
};

}  // namespace drivers::youbot_bus

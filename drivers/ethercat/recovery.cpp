#include "drivers/ethercat/recovery.hpp"

#include <algorithm>

namespace drivers::ethercat {

namespace {

// A request is written again when so many looks saw no change: its frame may have been lost.
constexpr int kLooksForAChange = 20;

}  // namespace

void Recovery::start(int steps) noexcept {
  succeeded_ = slaves_ == nullptr || slaves_->empty();
  active_ = !succeeded_;
  anew_.reset();
  slave_ = 0;
  steps_ = left_ = steps;
  step_ = Step::kObserve;
  block_state_ = AlState::kNone;
  patience_ = 0;
}

bool Recovery::add_to(FrameExchange& frame) noexcept {
  if (!active_) return false;
  if (step_ == Step::kWrite)
    return frame.add(write_.command, write_.address, write_.size,
                     std::span(write_.bytes).first(write_.size));
  return frame.add(Command::kFprd, station_address(at_work().station, reg::kAlStatus), 6);
}

void Recovery::on_lost() noexcept {
  if (active_ && --left_ <= 0) active_ = false;
}

void Recovery::on_reply(const DatagramView& d) noexcept {
  if (!active_) return;
  if (--left_ <= 0) active_ = false;
  if (step_ == Step::kWrite) {
    step_ = Step::kObserve;
    return;
  }
  if (d.counter == 1) {
    const AlStatus seen{d.data[0], load_u16(d.data, 4)};
    if (seen.state != status_.state) patience_ = 0;
    status_ = seen;
    return decide();
  }
  // Nobody, or more than one, has this address.
  write_ = {Command::kApwr, position_address(slave_, reg::kStation), 2, {}};
  store_u16(write_.bytes, 0, at_work().station);
  step_ = Step::kWrite;
  block_state_ = AlState::kNone;
  patience_ = 0;
}

void Recovery::decide() noexcept {
  if (block_state_ != status_.is()) {
    block_state_ = status_.is();
    block_ = 0;
  }
  const SlaveMapping& m = at_work();
  if (status_.error()) return write_al((status_.state & kAlStateMask) | kAlAcknowledge);
  switch (status_.is()) {
    case AlState::kInit:
      anew_[static_cast<std::size_t>(slave_)] = true;
      if (write_block(std::span(m.mailbox_setup).first(static_cast<std::size_t>(m.mailbox_blocks))))
        return;
      if (give_sii()) return;
      return write_al(static_cast<unsigned>(AlState::kPreOp));
    case AlState::kPreOp:
      if (write_block(std::span(m.data_setup).first(static_cast<std::size_t>(m.data_blocks))))
        return;
      return write_al(static_cast<unsigned>(AlState::kSafeOp));
    case AlState::kSafeOp:
      return write_al(static_cast<unsigned>(AlState::kOp));
    case AlState::kOp:
      return next_slave();
    default:
      return write_al(static_cast<unsigned>(AlState::kInit));
  }
}

bool Recovery::write_block(std::span<const RegisterBlock> blocks) noexcept {
  if (block_ >= blocks.size()) return false;
  const RegisterBlock& b = blocks[block_++];
  write_ = {Command::kFpwr, station_address(at_work().station, b.reg), b.size, {}};
  std::copy_n(b.bytes.begin(), b.size, write_.bytes.begin());
  step_ = Step::kWrite;
  return true;
}

// Register 0x0500, behind the mailbox blocks, as to_preop() does: from PREOP on the EEPROM is the
// application's, and after power was off it is the master's.
bool Recovery::give_sii() noexcept {
  if (block_ > static_cast<std::size_t>(at_work().mailbox_blocks)) return false;
  ++block_;
  write_ = {Command::kFpwr, station_address(at_work().station, reg::kSiiAccess), 1, {1}};
  step_ = Step::kWrite;
  return true;
}

void Recovery::write_al(unsigned value) noexcept {
  if (patience_ > 0) {  // asked; the slave may take its time
    // A block may have been lost with its frame: the next request is made behind all of them again.
    if (--patience_ == 0) block_ = 0;
    return;
  }
  patience_ = kLooksForAChange;
  write_ = {Command::kFpwr, station_address(at_work().station, reg::kAlControl), 2, {}};
  store_u16(write_.bytes, 0, value);
  step_ = Step::kWrite;
}

void Recovery::next_slave() noexcept {
  patience_ = 0;
  block_state_ = AlState::kNone;
  left_ = steps_;
  active_ = true;  // its last datagram brought it
  if (++slave_ < static_cast<int>(slaves_->size())) return;
  slave_ = static_cast<int>(slaves_->size()) - 1;
  active_ = false;
  succeeded_ = true;
}

}  // namespace drivers::ethercat

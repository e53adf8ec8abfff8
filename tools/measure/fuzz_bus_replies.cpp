// What slaves send back, through whoever asked: TMCL in mailboxes, a drive's process data, the
// reply to a cycle. Beyond ending well each has something to hold; what does not hold is an
// exception, and so a fault.
#include <algorithm>
#include <stdexcept>

#include "drivers/ethercat/mailbox_client.hpp"
#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/scan.hpp"
#include "drivers/ethercat/state_control.hpp"
#include "drivers/ethercat/twin/sii_builder.hpp"
#include "drivers/ethercat/twin/twin_port.hpp"
#include "drivers/tmcl/tmcl_frame.hpp"
#include "drivers/youbot_bus/process_data.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {
namespace {

namespace ec = drivers::ethercat;
namespace tmcl = drivers::tmcl;
namespace yb = drivers::youbot_bus;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint16_t kMailbox = 64;
constexpr std::size_t kOutputs = yb::kOutputBytes, kInputs = 20;

void hold(bool holds, const char* what) {
  if (!holds) throw std::logic_error(what);
}

Bytes bytes_of(const std::string& b) { return {b.begin(), b.end()}; }

// Answers every request with these bytes, and keeps what it was told.
struct FedSlave final : ec::EscApplication {
  Bytes answer, outputs;
  int requests = 0;
  bool on_mailbox(std::span<const std::uint8_t>, std::span<std::uint8_t> a,
                  rt::Time) noexcept override {
    ++requests;
    std::fill(std::copy_n(answer.begin(), std::min(answer.size(), a.size()), a.begin()), a.end(),
              std::uint8_t{0});
    return true;
  }
  void on_outputs(std::span<const std::uint8_t> b, rt::Time) noexcept override {
    outputs.assign(b.begin(), b.end());
  }
  void fill_inputs(std::span<std::uint8_t> b, rt::Time now) noexcept override {
    for (std::size_t i = 0; i < b.size(); ++i)
      b[i] = static_cast<std::uint8_t>(rt::ns_of(now) / 1'000'000 + static_cast<std::int64_t>(i));
  }
};

// A drive alone on its bus.
struct FedChain {
  FedChain() {
    ec::SiiBuilder sii;
    sii.identity(1, 2, 3, 4).strings({"fed"}).fmmus({1, 2});
    sii.mailbox(0x1000, kMailbox, 0x1000 + kMailbox, kMailbox, 0);
    sii.managers({{0x1000, kMailbox, 0x26, 1, 1},
                  {0x1000 + kMailbox, kMailbox, 0x22, 1, 2},
                  {0x1100, kOutputs, 0x24, 1, 3},
                  {0x1180, kInputs, 0x20, 1, 4}});
    auto made = std::make_unique<FedSlave>();
    slave = made.get();
    wire.add(
        std::make_unique<ec::Esc>(startup.token(), ec::EscConfig{}, sii.image(), std::move(made)));
  }
  rt::Startup startup;
  ec::TwinChain wire;
  ec::TwinPort port{wire};
  FedSlave* slave = nullptr;
};

// ---- TMCL in a mailbox: four bytes say which of the next 32 frames are lost, then the mailbox.

constexpr std::size_t kLosses = 4;
const tmcl::Request kAsked{0, static_cast<std::uint8_t>(tmcl::Command::kGetAxisParameter), 4, 0, 0};

// Bit i: frame i is lost, one with an odd number before it reaches the slave.
class LossyPort final : public ec::Port {
 public:
  LossyPort(ec::TwinPort& inner, std::uint32_t losses) : inner_(inner), losses_(losses) {}
  bool send(std::span<const std::uint8_t> f) noexcept override {
    if (sent_ < 32 && (losses_ >> sent_ & 1U) != 0)
      (sent_ % 2 != 0 ? inner_.faults().lose_out : inner_.faults().lose_back) = 1;
    ++sent_;
    return inner_.send(f);
  }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept override {
    return inner_.receive(into, deadline);
  }
  [[nodiscard]] rt::Time now() const noexcept override { return inner_.now(); }
  void sleep_until(rt::Time t) noexcept override { inner_.sleep_until(t); }

 private:
  ec::TwinPort& inner_;
  std::uint32_t losses_;
  unsigned sent_ = 0;
};

void round_trips(const tmcl::Reply& reply, std::span<const std::uint8_t> b) {
  const tmcl::MailboxFrame again = tmcl::encode(reply);
  hold(std::equal(again.begin(), again.end(), b.begin()), "a reply is another when written again");
  tmcl::Request request;
  hold(tmcl::decode(b, request), "bytes are a reply and no request");
  hold(tmcl::encode(request) == again, "a request is another when written again");
  tmcl::MailboxFrame frame{};
  hold(tmcl::from_serial(tmcl::to_serial(again), frame) && frame == again,
       "the serial form is another when read again");
  if (tmcl::answers(reply, kAsked))
    hold(reply.status == 100 && reply.command == kAsked.command, "it answers with a wrong status");
  if (const auto f = tmcl::firmware_of(b))
    hold(f->controller >= 0 && f->version >= 0, "a firmware below 0");
}

rt::Result<bool> read_mailbox(const std::string& text) {
  if (text.size() < kLosses) return rt::Error{"no mailbox"};
  const Bytes all = bytes_of(text);
  FedChain chain;
  chain.slave->answer.assign(all.begin() + kLosses, all.end());
  ec::RegisterAccess registers(chain.port);
  const auto found = ec::scan(chain.startup.token(), registers);
  hold(found && found.value().size() == 1, "the slave is not found");
  const ec::SlaveInfo& info = found.value()[0];
  const auto mapping = ec::map_process_data(found.value());
  hold(mapping && ec::to_preop(registers, info, mapping.value().slaves[0], std::chrono::seconds{1}),
       "the slave is not in PREOP");
  LossyPort lossy(chain.port, ec::load_u32(all, 0));
  ec::MailboxClient client(lossy);
  const auto came = client.raw(info, tmcl::encode(kAsked));
  hold(chain.slave->requests <= 1, "a request came twice");
  if (!came) return rt::Error{came.error()};
  Bytes wanted = chain.slave->answer;
  wanted.resize(kMailbox, 0);
  hold(chain.slave->requests == 1 && came.value() == wanted, "another reply than the slave's");
  tmcl::Reply reply;
  hold(tmcl::decode(came.value(), reply), "a whole mailbox is too short");
  round_trips(reply, came.value());
  if (!tmcl::answers(reply, kAsked)) return rt::Error{"does not answer the request"};
  return true;
}

// ---- process data: every length from the first byte on

void decode_inputs(std::span<const std::uint8_t> b) {
  const yb::DriveInputs untouched{1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
  yb::DriveInputs in = untouched;
  const bool took = yb::decode(b, in);
  hold(took == (b.size() == 16 || b.size() == 18 || b.size() == 20 || b.size() == 32),
       "inputs of an unknown size, or none of a known one");
  if (!took) return hold(in == untouched, "inputs that were refused are another");
  Bytes again(b.size());
  hold(yb::encode(in, again) && std::equal(b.begin(), b.end(), again.begin()),
       "inputs are others when written again");
}

void decode_outputs(std::span<const std::uint8_t> b) {
  const yb::DriveOutputs untouched{7, yb::ControllerMode::kPwm};
  yb::DriveOutputs out = untouched;
  const bool took = yb::decode(b, out);
  hold(took == (b.size() == 5 && b[4] <= 7), "outputs of a wrong size or mode, or none");
  if (!took) return hold(out == untouched, "outputs that were refused are another");
  std::array<std::uint8_t, 5> again{};
  hold(yb::encode(out, again) && std::equal(b.begin(), b.end(), again.begin()),
       "outputs are others when written again");
}

rt::Result<bool> read_process_data(const std::string& text) {
  const Bytes all = bytes_of(text);
  for (std::size_t n = 0; n <= std::min<std::size_t>(all.size(), 40); ++n) {
    decode_inputs(std::span(all).first(n));
    decode_outputs(std::span(all).first(n));
  }
  if (all.size() == kOutputs ? all[4] <= 7 : yb::known_input_size(all.size())) return true;
  return rt::Error{"no process data of a drive"};
}

// ---- the reply to a cycle: a byte says which, then the frame

enum class Cycle : std::uint8_t { kWhole, kRead, kWrite, kRecovery };
constexpr unsigned kCycles = 4;

// Passes frames on until it is fed; then it keeps what is sent, and gives back what it was fed.
class FedPort final : public ec::Port {
 public:
  explicit FedPort(ec::TwinPort& inner) : inner_(inner) {}
  bool send(std::span<const std::uint8_t> f) noexcept override {
    if (fed == nullptr) return inner_.send(f);
    sent.assign(f.begin(), f.end());
    return true;
  }
  std::size_t receive(std::span<std::uint8_t> into, rt::Time deadline) noexcept override {
    if (fed == nullptr) return inner_.receive(into, deadline);
    if (sent.empty() || given) return 0;
    given = true;
    const std::size_t n = std::min(fed->size(), into.size());
    std::copy_n(fed->begin(), n, into.begin());
    return n;
  }
  [[nodiscard]] rt::Time now() const noexcept override { return inner_.now(); }
  void sleep_until(rt::Time t) noexcept override { inner_.sleep_until(t); }
  const Bytes* fed = nullptr;
  Bytes sent;
  bool given = false;

 private:
  ec::TwinPort& inner_;
};

// By the standard's words: is this the frame that was sent? What slaves change: position of BRD and
// AP, events, data, counters. Reserved bits say nothing.
bool is_reply(const Bytes& sent, std::span<const std::uint8_t> b) {
  b = b.first(std::min(b.size(), ec::kMaxFrame));
  const auto word = [](std::span<const std::uint8_t> f, std::size_t at) {
    return static_cast<unsigned>(f[at] | f[at + 1] << 8U);
  };
  const std::size_t end = 16 + (word(sent, 14) & 0x7FFU);
  if (b.size() < end || b[12] != 0x88 || b[13] != 0xA4) return false;
  if ((word(b, 14) & 0xF7FFU) != (word(sent, 14) & 0xF7FFU)) return false;
  for (std::size_t at = 16; at < end;) {
    const bool counted = (b[at] >= 1 && b[at] <= 3) || (b[at] >= 7 && b[at] <= 9) || b[at] == 13;
    for (std::size_t i = 0; i < 6; ++i)
      if ((i < 2 || i > 3 || !counted) && b[at + i] != sent[at + i]) return false;
    if (((word(b, at + 6) ^ word(sent, at + 6)) & 0xC7FFU) != 0) return false;
    at += 12 + (word(sent, at + 6) & 0x7FFU);
  }
  return true;
}

struct CycleRig {
  CycleRig() {
    auto& nrt = chain.startup.token();
    hold(master.find(nrt) && master.configure(nrt) && master.start(nrt), "no chain in OP");
    hold(yb::encode(yb::DriveOutputs{600, yb::ControllerMode::kVelocity}, master.outputs(0)),
         "outputs");
    for (int i = 0; i < 3; ++i) next();
    chain.slave->answer = {2, 0, 100, 6, 0, 0, 2, 0};
    hold(master.post(0, tmcl::encode(kAsked), 20), "a transfer is under way");
  }
  ec::CycleResult next() {
    chain.port.set_now(chain.port.now() + std::chrono::milliseconds{1});
    return master.exchange();
  }
  ec::CycleResult one(Cycle c) {
    if (c == Cycle::kRead) return master.read_inputs();
    if (c == Cycle::kWrite) return master.write_outputs();
    if (c == Cycle::kRecovery) master.recover();
    return master.exchange();
  }
  FedChain chain;
  FedPort port{chain.port};
  ec::Master master{chain.startup.token(), port};
};

// Where the process data of a reply stands that has it in its first datagram.
void inputs_are_of(const CycleRig& rig, Cycle c, std::span<const std::uint8_t> frame) {
  const std::size_t at = 26 + (c == Cycle::kRead ? 0 : kOutputs);
  const auto in = rig.master.inputs(0);
  hold(std::equal(in.begin(), in.end(), frame.begin() + static_cast<std::ptrdiff_t>(at)),
       "inputs are not those of the reply");
}

rt::Result<bool> read_reply(const std::string& text) {
  if (text.empty()) return rt::Error{"no cycle"};
  CycleRig rig;
  const auto c = static_cast<Cycle>(static_cast<std::uint8_t>(text[0]) % kCycles);
  const Bytes frame = bytes_of(text.substr(1));
  const Bytes inputs(rig.master.inputs(0).begin(), rig.master.inputs(0).end());
  const auto before = rig.master.frames();
  rig.port.fed = &frame;
  const ec::CycleResult r = rig.one(c);
  rig.port.fed = nullptr;
  const bool reply = is_reply(rig.port.sent, frame);
  hold(reply == (r.status == ec::CycleStatus::kOk || r.status == ec::CycleStatus::kShort),
       "a frame is taken for the reply and is not, or is and is not taken");
  const auto& n = rig.master.frames();
  const std::uint64_t others = n.foreign + n.damaged - before.foreign - before.damaged;
  hold(n.sent == before.sent + 1 && n.lost - before.lost == (reply ? 0U : 1U),
       "frames are miscounted");
  hold(others == (reply || frame.empty() ? 0U : 1U), "a frame that is no reply is miscounted");
  hold((r.status == ec::CycleStatus::kOk) == (reply && r.counter == r.expected), "its counter");
  if (r.status == ec::CycleStatus::kOk && c != Cycle::kWrite) {
    inputs_are_of(rig, c, frame);
  } else {
    hold(std::equal(inputs.begin(), inputs.end(), rig.master.inputs(0).begin()),
         "inputs of no good cycle");
  }
  hold(!rig.master.stopped(), "one bad cycle stops");
  // Whatever it said, the master finds back: recovery and transfer end, and cycles are good.
  int left = 6000;
  while ((rig.master.recovering() || rig.master.mailbox().busy()) && --left > 0) (void)rig.next();
  hold(left > 0, "recovery or transfer do not end");
  hold(rig.next().status == ec::CycleStatus::kOk, "the cycle after it is not good");
  hold(rig.chain.slave->outputs.size() == kOutputs, "no outputs");
  if (r.status != ec::CycleStatus::kOk) return rt::Error{to_text(r.status)};
  return true;
}

// The true reply, as the chain gives it.
std::string cycle_seed(Cycle c) {
  CycleRig rig;
  const Bytes none;
  rig.port.fed = &none;
  (void)rig.one(c);
  Bytes frame = rig.port.sent;
  rig.chain.wire.pass(frame, rig.chain.port.now());
  return static_cast<char>(c) + std::string(frame.begin(), frame.end());
}

}  // namespace

void FuzzReaders::add_bus_replies() {
  const auto text = [](const auto& b) { return std::string(b.begin(), b.end()); };
  const auto reply = text(tmcl::encode(tmcl::Reply{2, 0, 100, 6, -711}));
  const std::string whole(kLosses, '\0'), reads_lost("\x50\x01\0\0", kLosses);
  readers_.push_back({"tmcl_mailbox",
                      {whole + reply, reads_lost + reply + "the rest of a mailbox"},
                      read_mailbox,
                      {},
                      false});
  std::vector<std::string> data;
  for (const std::size_t n : {5U, 16U, 18U, 20U, 32U}) {
    std::string b(n, '\x01');
    for (std::size_t i = 0; i < n; ++i) b[i] = static_cast<char>(n == 5 ? i : 37 * i);
    data.push_back(b);
  }
  readers_.push_back({"process_data", std::move(data), read_process_data, {}, false});
  std::vector<std::string> replies;
  for (unsigned c = 0; c < kCycles; ++c) replies.push_back(cycle_seed(static_cast<Cycle>(c)));
  readers_.push_back({"ethercat_reply", std::move(replies), read_reply, {}, false});
}

}  // namespace teletact

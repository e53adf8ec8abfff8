#include "drivers/youbot_bus/ethercat_youbot.hpp"

#include "drivers/youbot/motor_flags.hpp"
#include "drivers/youbot_bus/youbot_setup.hpp"

namespace drivers::youbot_bus {

namespace {

constexpr rt::Nanos kCyclePeriod = std::chrono::milliseconds{1};
constexpr rt::Nanos kKeepPeriod = std::chrono::milliseconds{10};
constexpr int kClearCycles = 2000;

// A board that could not be read says why itself; it may be one of a youBot's.
std::string unread(const std::vector<ethercat::SlaveInfo>& slaves) {
  for (const auto& s : slaves)
    if (s.sii.name.empty() && !s.problem.empty()) return s.problem;
  return {};
}

rt::Error not_a_youbot(const std::vector<ethercat::SlaveInfo>& slaves, ChainKind wanted) {
  const auto wrong = check_chain(wanted, slaves);
  std::string text = std::string("not a youBot '") + to_text(wanted) +
                     "': " + (wrong.empty() ? "the boards differ" : wrong.front());
  if (wrong.size() > 1) text += " (and " + std::to_string(wrong.size() - 1) + " more)";
  return rt::Error{text};
}

// With no chain stated: the one that the number of slaves comes nearest to.
ChainKind nearest(std::size_t slaves) {
  if (slaves <= 5) return ChainKind::kBase;
  if (slaves == 6) return ChainKind::kArm;
  return slaves <= 11 ? ChainKind::kBaseArm : ChainKind::kBaseTwoArms;
}

// Of the chain that is wanted, or of the shortest one that begins with these boards.
std::string what_is_missing(const std::vector<ethercat::SlaveInfo>& slaves,
                            std::optional<ChainKind> wanted) {
  for (const ChainKind k : kChainKinds) {
    if (wanted && k != *wanted) continue;
    if (std::string missing = missing_boards(k, slaves); !missing.empty()) return missing;
  }
  return {};
}

MotorBusConfig layout(ChainKind kind, const YoubotConfig& c) {
  MotorBusConfig out;
  out.gear_ratio = c.gear_ratio;
  out.arm_rest = c.arm_rest;
  out.ignored_flags = c.ignored_flags;
  const auto boards = boards_of(kind);
  for (std::size_t i = 0; i < boards.size(); ++i) {
    if (boards[i].kind == BoardKind::kWheel)
      out.slave[static_cast<std::size_t>(boards[i].number)] = i;
    if (boards[i].kind == BoardKind::kJoint) out.joints.push_back(i);
  }
  return out;
}

// The first drive that does not know its commutation, by name; empty: all know it.
std::string without_commutation(ChainKind kind, const ethercat::Master& master) {
  const auto boards = boards_of(kind);
  for (std::size_t i = 0; i < boards.size(); ++i) {
    DriveInputs in;
    if (!boards[i].is_drive()) continue;
    if (!decode(master.inputs(i), in) || (in.flags & motor_flag::kInitialised) == 0)
      return boards[i].name();
  }
  return {};
}

rt::Result<ChainKind> try_bring_up(rt::NonRealtime& nrt, ethercat::Master& master,
                                   const std::string& chain) {
  if (const auto found = master.find(nrt); !found) return rt::Error{found.error()};
  if (const std::string why = unread(master.slaves()); !why.empty()) return rt::Error{why};
  const auto there = find_chain(master.slaves());
  const auto wanted = chain_kind_of(chain);
  if (!there || (wanted && *wanted != *there)) {
    const std::string missing = what_is_missing(master.slaves(), wanted);
    if (!missing.empty()) return rt::Error{missing};
    return not_a_youbot(master.slaves(), wanted ? *wanted : nearest(master.slaves().size()));
  }
  const auto wrong = check_chain(*there, master.slaves());
  if (!wrong.empty()) return not_a_youbot(master.slaves(), *there);
  if (const auto done = master.configure(nrt); !done) return rt::Error{done.error()};
  if (const auto done = master.start(nrt); !done) return rt::Error{done.error()};
  return *there;
}

}  // namespace

rt::Result<ChainKind> bring_up(rt::NonRealtime& nrt, ethercat::Master& master,
                               const std::string& chain) {
  auto there = try_bring_up(nrt, master, chain);
  const std::string losses = master.losses();
  if (there || losses.empty()) return there;
  return rt::Error{there.error() + " (" + losses + ": look at cable, plugs and card)"};
}

rt::Result<std::unique_ptr<EtherCatYoubot>> EtherCatYoubot::open(
    rt::NonRealtime& nrt, std::unique_ptr<ethercat::Port> port, const YoubotConfig& c) {
  std::unique_ptr<EtherCatYoubot> out(new EtherCatYoubot(nrt));
  out->port_ = std::move(port);
  out->master_ = std::make_unique<ethercat::Master>(nrt, *out->port_, c.master);
  const auto kind = bring_up(nrt, *out->master_, c.chain);
  if (!kind) return rt::Error{kind.error()};
  if (kind.value() == ChainKind::kArm) return rt::Error{"an arm alone has no wheels to drive"};
  if (c.calibration) {
    const std::string other = other_robot(*c.calibration, out->master_->slaves());
    if (!other.empty()) return rt::Error{"calibration: " + other};
  }
  out->kind_ = kind.value();
  if (c.most_current_mA > 0) {
    DriveSession look(nrt, *out->master_, *out->port_, out->kind_);
    const auto above = above_current(look, c.most_current_mA);
    if (!above) return rt::Error{above.error()};
    if (!above.value().empty())
      return rt::Error{above.value() + ", most_current_A allows " +
                       std::to_string(c.most_current_mA) + " mA"};
  }
  out->bus_ = std::make_unique<EtherCatMotorBus>(nrt, *out->master_, layout(out->kind_, c));
  out->bus_->rearm();
  MotorStates ignored;
  rt::Time next = out->port_->now();
  for (int i = 0; i < kClearCycles && (i == 0 || out->bus_->rearming()); ++i) {
    (void)out->bus_->exchange(next, {}, ignored);
    out->port_->sleep_until(next += kCyclePeriod);
  }
  if (out->bus_->rearming())
    return rt::Error{"the motors' timeout flags do not clear (axis parameter 158)"};
  (void)out->bus_->exchange(next, {}, ignored);
  const std::string lacks = without_commutation(out->kind_, *out->master_);
  if (!lacks.empty())
    return rt::Error{lacks +
                     " has no commutation yet: teletact youbot setup finds it, with the robot "
                     "free to move"};
  return out;
}

EtherCatYoubot::~EtherCatYoubot() {
  wanted_.store(true, std::memory_order_release);
  if (keeper_.joinable()) keeper_.join();
  master_->stop(nrt_);
}

void EtherCatYoubot::keep_alive(rt::NonRealtime&) {
  if (keeper_.joinable() || wanted_.load()) return;
  kept_.store(true, std::memory_order_release);
  keeper_ = std::thread([this] {
    MotorStates ignored;
    rt::Time next = port_->now();
    while (!wanted_.load(std::memory_order_acquire)) {
      (void)bus_->exchange(next, {}, ignored);
      port_->sleep_until(next += kKeepPeriod);
    }
    kept_.store(false, std::memory_order_release);
  });
}

bool EtherCatYoubot::taken_over() noexcept {
  if (!wanted_.load(std::memory_order_relaxed)) wanted_.store(true, std::memory_order_release);
  return !kept_.load(std::memory_order_acquire);
}

BusStatus EtherCatYoubot::sense(rt::Time now, MotorStates& states) noexcept {
  return taken_over() ? bus_->sense(now, states) : BusStatus::kFrameLost;
}

BusStatus EtherCatYoubot::act(rt::Time now, const MotorSetpoints& setpoints) noexcept {
  return taken_over() ? bus_->act(now, setpoints) : BusStatus::kFrameLost;
}

void EtherCatYoubot::rearm() noexcept {
  if (taken_over()) bus_->rearm();
}

std::string EtherCatYoubot::description() const {
  return std::string(to_text(kind_)) + " on " + std::to_string(master_->slaves().size()) +
         " slaves";
}

}  // namespace drivers::youbot_bus

// A youBot's bus from nothing to robot_io's MotorBus, on any wire: a network card, or the virtual
// chain.
//
//   open     scan, which youBot it is by the boards' names, all slaves to OP, the drives' timeout
//            flags cleared. Nothing moves: outputs are motor stop, and then each arm joint holds
//            where it is. An error has one line; a wrong chain names its first wrong slave. Drives
//            that have no commutation are an error too, since to find it moves them.
//   keeper   From open() to the first sense() an ordinary thread exchanges frames every 10 ms, so
//            that the slaves' watchdogs do not expire while the box gets ready. The first sense()
//            asks it to end and counts as a lost frame until it has, at most 20 ms.
//   end      the destructor sends zero outputs (motor stop, arms too) and brings the slaves to
//            SAFEOP: Master::stop(), 60 ms at most. The token of open() outlives this object.
//   cycle    EtherCatMotorBus (ethercat_motor_bus.hpp).
#pragma once

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "drivers/youbot_bus/calibration_file.hpp"
#include "drivers/youbot_bus/chain_layout.hpp"
#include "drivers/youbot_bus/ethercat_motor_bus.hpp"
#include "rt/result.hpp"

namespace drivers::youbot_bus {

struct YoubotConfig {
  std::string chain = "any";  // or base, base+arm, base+2arms: what must be there
  double gear_ratio = 9405.0 / 364.0;
  ArmRest arm_rest = ArmRest::kHold;
  std::uint32_t ignored_flags = 0;   // MotorBusConfig
  std::int32_t most_current_mA = 0;  // a drive that may take more is an error; 0: any
  // What homing measured on this robot; another robot's is an error.
  std::optional<Calibration> calibration;
  ethercat::MasterConfig master;
};

// Scan, check and OP, for whoever works on the chain.
[[nodiscard]] rt::Result<ChainKind> bring_up(rt::NonRealtime&, ethercat::Master&,
                                             const std::string& chain);

class EtherCatYoubot final : public MotorBus {
 public:
  [[nodiscard]] static rt::Result<std::unique_ptr<EtherCatYoubot>> open(
      rt::NonRealtime&, std::unique_ptr<ethercat::Port>, const YoubotConfig&);
  ~EtherCatYoubot() override;

  [[nodiscard]] BusStatus sense(rt::Time now, MotorStates& states) noexcept override;
  [[nodiscard]] BusStatus act(rt::Time now, const MotorSetpoints& setpoints) noexcept override;
  [[nodiscard]] BusDetail detail() const noexcept override { return bus_->detail(); }
  void rearm() noexcept override;
  void make_safe() noexcept override { bus_->make_safe(); }

  // Owner's thread, or before the first sense().
  void keep_alive(rt::NonRealtime&);
  [[nodiscard]] ChainKind kind() const noexcept { return kind_; }
  [[nodiscard]] ethercat::Master& master() noexcept { return *master_; }
  // "base+arm on 11 slaves"
  [[nodiscard]] std::string description() const;

 private:
  explicit EtherCatYoubot(rt::NonRealtime& nrt) noexcept : nrt_(nrt) {}
  [[nodiscard]] bool taken_over() noexcept;

  rt::NonRealtime& nrt_;
  std::unique_ptr<ethercat::Port> port_;
  std::unique_ptr<ethercat::Master> master_;
  std::unique_ptr<EtherCatMotorBus> bus_;
  ChainKind kind_ = ChainKind::kBase;
  std::atomic<bool> wanted_{false}, kept_{false};  // the owner calls; the keeper runs
  std::thread keeper_;
};

}  // namespace drivers::youbot_bus

// The bus that `teletact ethercat` works on: a network card, or the virtual youBot in this process.
#pragma once

#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "drivers/ethercat/capture_port.hpp"
#include "drivers/ethercat/card_claim.hpp"
#include "drivers/ethercat/master.hpp"
#include "drivers/ethercat/twin/twin_port.hpp"
#include "drivers/youbot_bus/twin/youbot_chain.hpp"

namespace teletact {

// A slave does not do what was asked: exit code 1, where bad input is 2.
struct CouldNotDo : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct EtherCatChoice {
  std::string iface, twin, capture;
  std::string generation;  // of the twin's boards: old or new; empty: new
  bool end_stops = false;  // of the twin's joints
  std::string effects;     // file of the twin's motors' effects
  // Nothing but reads that change nothing: beside a program that owns the card, too.
  bool looks = false;
};

// One bus, and nothing of a twin for a network card. Throws std::runtime_error with one line.
void check_choice(const EtherCatChoice&);
// Of a file; an empty name: none. Throws std::runtime_error with one line.
[[nodiscard]] drivers::youbot_bus::MotorEffects motor_effects(const std::string& file);

class EtherCatSession {
 public:
  // Of a network card: it is this session's, or the session only looks. Throws CouldNotDo if
  // another program owns it, std::runtime_error for the rest, with one line.
  explicit EtherCatSession(const EtherCatChoice&);
  // A chain that was started ends with zero outputs, in SAFEOP (Master::stop).
  ~EtherCatSession();
  EtherCatSession(const EtherCatSession&) = delete;
  EtherCatSession& operator=(const EtherCatSession&) = delete;

  [[nodiscard]] drivers::ethercat::Master& master() { return *master_; }
  [[nodiscard]] drivers::ethercat::RegisterAccess& registers() { return master_->registers(); }
  [[nodiscard]] drivers::ethercat::Port& port() { return *port_; }
  [[nodiscard]] rt::NonRealtime& token() { return startup_.token(); }
  // Of the twin that was asked for.
  [[nodiscard]] std::optional<drivers::youbot_bus::ChainKind> twin_kind() const { return kind_; }

  // Addresses them all; they are in INIT after it. Throws CouldNotDo if no frame comes back. The
  // slave that a person counts from 1.
  void find();
  [[nodiscard]] std::size_t slave(int number) const;
  // Number of slaves, and registers by position: no slave changes its state. CouldNotDo as above.
  [[nodiscard]] int count();
  [[nodiscard]] bool look(int position, std::uint16_t reg, std::span<std::uint8_t> into);
  // The chain is stopped, and the pcap file is whole; throws else.
  void finish();
  // Frames in the pcap file.
  [[nodiscard]] std::uint64_t captured() const { return capture_ ? capture_->frames() : 0; }

 private:
  rt::Startup startup_;
  std::optional<drivers::youbot_bus::ChainKind> kind_;
  std::unique_ptr<drivers::youbot_bus::YoubotChain> chain_;
  std::unique_ptr<drivers::ethercat::CardClaim> claim_;
  std::unique_ptr<drivers::ethercat::Port> wire_;
  std::unique_ptr<drivers::ethercat::CapturePort> capture_;
  drivers::ethercat::Port* port_ = nullptr;
  std::unique_ptr<drivers::ethercat::Master> master_;
};

}  // namespace teletact

// A witness of ticks: it sees every row of every rig (haptic_rig.hpp) of its thread while it
// stands, whatever the caller keeps of them. The gates of the hard cases
// (tools/measure/stability/gates.hpp) are judged by it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "rt/hash.hpp"
#include "tasks/haptic/haptic_task.hpp"

namespace rig {

class Witness {
 public:
  Witness() : outer_(current()) { current() = this; }
  ~Witness() { current() = outer_; }
  Witness(const Witness&) = delete;
  Witness& operator=(const Witness&) = delete;
  // Of this thread; null: none stands.
  [[nodiscard]] static Witness*& current() {
    thread_local Witness* witness = nullptr;
    return witness;
  }

  template <class Row>
  void take(const Row& row) {
    ++ticks;
    for (const perception::Vec3* v : {&row.h, &row.p, &row.f, &row.f_raw}) {
      for (int a = 0; a < 3; ++a) hash_.value((*v)[a]);
    }
    const tasks::HapticTelemetry& t = row.telemetry;
    for (const double v : {t.energy_J, t.booked_J, t.friction_N, t.controller_N, t.gain, t.blend}) {
      hash_.value(v);
    }
    hash_.word(t.work);
    hash_.word((t.in_contact ? 1U : 0U) | (t.guard_active ? 2U : 0U) | (t.guard_use ? 4U : 0U) |
               (t.held ? 8U : 0U) | (t.unresolved ? 16U : 0U));
    const bool finite = row.p.allFinite() && row.f.allFinite() && row.f_raw.allFinite();
    not_finite += finite ? 0U : 1U;
    if (finite) force_max_N = std::max(force_max_N, row.f.norm());
    if (row.controlled) {
      controlled = true;
      const double e = t.energy_J + t.booked_J + t.credit_J;
      if (!(e >= energy_min_J)) energy_min_J = e;
    }
    allocations += row.allocations;
    locks += row.locks;
    if (t.in_contact) {
      cpu_us.push_back(static_cast<float>(row.cpu_us));
      work.push_back(t.work);
    }
  }
  // Of everything that was answered so far, bit by bit. CPU time is no part of it.
  [[nodiscard]] std::uint64_t digest() const { return hash_.digest(); }

  std::size_t ticks = 0, not_finite = 0;
  double force_max_N = 0;
  bool controlled = false;  // by the passivity controller, in some of the ticks
  double energy_min_J = 0;  // E + booked + credit, in those
  std::uint64_t allocations = 0, locks = 0;
  // Of the ticks in contact.
  std::vector<float> cpu_us;
  std::vector<std::uint32_t> work;

 private:
  Witness* outer_;
  rt::Hash64 hash_;
};

}  // namespace rig

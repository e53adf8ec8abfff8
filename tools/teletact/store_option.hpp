// The option --store-cap of the commands that run boxes.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>

#include "rt/store/run_store.hpp"

namespace teletact {

inline void add_store_cap(CLI::App& app, rt::StoreOptions& store) {
  app.add_option_function<std::uint64_t>(
         "--store-cap", [&store](std::uint64_t MiB) { store.cap_bytes = MiB << 20U; },
         "MiB on the disk for the job records of each box, default 256; the older ones become "
         "counts and histograms")
      ->check(CLI::Range(rt::StoreOptions::kLeastCap >> 20U, std::uint64_t{1} << 24U));
}

}  // namespace teletact

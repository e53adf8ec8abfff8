// The halves of a run in files: what one process of a run writes and the other reads back.
#include <cstdio>
#include <fstream>

#include "tools/host/run_results.hpp"

namespace teletact {

namespace {

// Plain records in and out. The file is read by the build that wrote it, on the same host.
struct Saver {
  std::ofstream out;
  template <class... T>
  void one(const T&... v) {
    (out.write(reinterpret_cast<const char*>(&v), sizeof v), ...);
  }
  template <class T>
  void many(const std::vector<T>& v) {
    one(static_cast<std::uint64_t>(v.size()));
    out.write(reinterpret_cast<const char*>(v.data()),
              static_cast<std::streamsize>(v.size() * sizeof(T)));
  }
};

struct Loader {
  std::ifstream in;
  template <class T>
  bool one(T& v) {
    return static_cast<bool>(in.read(reinterpret_cast<char*>(&v), sizeof v));
  }
  template <class T>
  bool many(std::vector<T>& v) {
    std::uint64_t n = 0;
    if (!one(n) || n > (1ULL << 28U)) return false;
    v.resize(n);
    return static_cast<bool>(
        in.read(reinterpret_cast<char*>(v.data()), static_cast<std::streamsize>(n * sizeof(T))));
  }
};

template <class Body>
bool save_whole(const std::string& path, const Body& body) {
  Saver s{std::ofstream(path + ".tmp", std::ios::binary)};
  body(s);
  s.out.close();  // a full disk may show only now: the last whole one must outlive it
  return s.out && std::rename((path + ".tmp").c_str(), path.c_str()) == 0;
}

}  // namespace

bool save_half(const std::string& folder, const OperatorHalf& h) {
  return save_half(folder, h, h.view, h.link);
}

bool save_half(const std::string& folder, const OperatorHalf& h, const OperatorView& view,
               const LinkSeen& link) {
  return save_whole(folder + "/operator.view", [&](Saver& s) {
    s.one(h.epoch_ns);
    s.many(view.haptic);
    s.many(view.haptic_thin.kept);
    s.one(view.haptic_past);
    s.one(view.fusion_past);
    s.many(view.touched_past);
    s.many(view.fusion);
    s.many(link.newest);
    s.one(link.past);
    s.many(view.paths);
    s.one(view.task);
    s.one(view.camera);
    s.one(view.objects);
    s.one(view.objects_named);
    s.one(view.mode);
    s.one(view.robot);
    s.one(view.world);
    s.one(view.error_max_m);
    s.one(view.unsure_s);
    s.one(view.held_s);
    s.one(view.held, view.held_ms, view.held_limit_ms);
    s.many(view.arrived);
    s.one(view.arrivals);
    s.one(view.first_arrival);
    s.one(view.points_resolved);
    s.many(view.visits);
    s.one(view.device_brakes);
    s.one(view.engages, view.clears, view.edits);
    s.one(view.log_dropped);
    s.one(*view.view);
    s.one(*view.map);
    s.one(*view.moving_view);
    s.one(*view.moving_map);
    s.many(h.totals);
    s.one(h.dropped_records);
    s.one(h.hangs);
    s.one(h.link_round_trip_ns);
    s.one(h.link_uncertainty_ns);
    s.one(h.force_check);
    s.one(h.ordinary);
    s.one(h.complete);
  });
}

void load_half(const std::string& folder, OperatorHalf& h, const rt::StorePiece& piece) {
  Loader l{std::ifstream(folder + "/operator.view", std::ios::binary)};
  h.complete = false;
  (void)(l.one(h.epoch_ns) && l.many(h.view.haptic) && l.many(h.view.haptic_thin.kept) &&
         l.one(h.view.haptic_past) && l.one(h.view.fusion_past) && l.many(h.view.touched_past) &&
         l.many(h.view.fusion) && l.many(h.link.newest) && l.one(h.link.past) &&
         l.many(h.view.paths) && l.one(h.view.task) && l.one(h.view.camera) &&
         l.one(h.view.objects) && l.one(h.view.objects_named) && l.one(h.view.mode) &&
         l.one(h.view.robot) && l.one(h.view.world) && l.one(h.view.error_max_m) &&
         l.one(h.view.unsure_s) && l.one(h.view.held_s) && l.one(h.view.held) &&
         l.one(h.view.held_ms) && l.one(h.view.held_limit_ms) && l.many(h.view.arrived) &&
         l.one(h.view.arrivals) && l.one(h.view.first_arrival) && l.one(h.view.points_resolved) &&
         l.many(h.view.visits) && l.one(h.view.device_brakes) && l.one(h.view.engages) &&
         l.one(h.view.clears) && l.one(h.view.edits) && l.one(h.view.log_dropped) &&
         l.one(*h.view.view) && l.one(*h.view.map) && l.one(*h.view.moving_view) &&
         l.one(*h.view.moving_map) && l.many(h.totals) && l.one(h.dropped_records) &&
         l.one(h.hangs) && l.one(h.link_round_trip_ns) && l.one(h.link_uncertainty_ns) &&
         l.one(h.force_check) && l.one(h.ordinary) && l.one(h.complete));
  if (auto log = rt::read_run(folder + "/operator.run", piece)) h.log = std::move(log).value();
}

bool save_half(const std::string& folder, const RobotHalf& h) {
  return save_half(folder, h, h.view);
}

bool save_half(const std::string& folder, const RobotHalf& h, const RobotView& view) {
  return save_whole(folder + "/robot.view", [&](Saver& s) {
    s.one(h.epoch_ns);
    s.many(view.robot);
    s.many(view.truth);
    s.many(view.robot_past.kept);
    s.many(view.truth_past.kept);
    s.one(view.tracking_error_max_m);
    s.one(view.mode);
    s.one(view.log_dropped);
    s.many(h.totals);
    s.one(h.camera_twin_cpu_ns);
    s.one(h.ordinary);
    s.one(h.dropped_records);
    s.one(h.hangs);
    s.one(h.complete);
  });
}

void load_half(const std::string& folder, RobotHalf& h, const rt::StorePiece& piece) {
  Loader l{std::ifstream(folder + "/robot.view", std::ios::binary)};
  h.complete = false;
  (void)(l.one(h.epoch_ns) && l.many(h.view.robot) && l.many(h.view.truth) &&
         l.many(h.view.robot_past.kept) && l.many(h.view.truth_past.kept) &&
         l.one(h.view.tracking_error_max_m) && l.one(h.view.mode) && l.one(h.view.log_dropped) &&
         l.many(h.totals) && l.one(h.camera_twin_cpu_ns) && l.one(h.ordinary) &&
         l.one(h.dropped_records) && l.one(h.hangs) && l.one(h.complete));
  if (auto log = rt::read_run(folder + "/robot.run", piece)) h.log = std::move(log).value();
}

void save_effects(const std::string& folder, const std::string& box, const Effects& effects) {
  std::ofstream out(folder + "/" + box + ".effects");
  for (const auto& [name, key] : effects) out << name << '\t' << key << '\n';
}

Effects load_effects(const std::string& folder) {
  Effects all;
  for (const char* box : {"operator", "robot"}) {
    std::ifstream in(folder + "/" + box + ".effects");
    for (std::string line; std::getline(in, line);) {
      const auto tab = line.find('\t');
      if (tab != std::string::npos) all.emplace_back(line.substr(0, tab), line.substr(tab + 1));
    }
  }
  return all;
}

}  // namespace teletact

#include "tools/measure/haptic/table_run.hpp"

#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "perception/tsdf/patch/patch_copy.hpp"
#include "tools/record/fusion_sequence.hpp"

namespace teletact {

using perception::Pose;
using perception::RgbdFrame;
using perception::SurfacePatch;
using perception::Vec3;

namespace {

constexpr double kVoxel_m = 0.01;
// Of the small cube: on the table, beside the book, 20 cm from the table's front edge.
const Vec3 kTable_W(3.02, 0.72, 0.74);
const Vec3 kRoom_W(1.5, 0.0, 1.25);

// From above the table's front edge, turned about it.
Pose near_pose(double t) {
  const double turn = 2 * std::numbers::pi * t;
  return looking(Vec3(2.45 + 0.08 * std::sin(turn / 3), 0.72 + 0.22 * std::sin(turn / 5), 1.32),
                 0.15 * std::sin(turn / 4), 0.75, 0);
}

Vec3 cube_centre(int edge) {
  const double share = (edge - 64) / 448.0;  // from the table to the room
  return kTable_W + share * (kRoom_W - kTable_W);
}

// Readings whose point lies outside the cube are taken out.
void crop(const Pose& X_WC, const Vec3& centre, double half, RgbdFrame& f) {
  const auto& k = f.intrinsics;
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      auto& mm = f.depth_mm[static_cast<std::size_t>(v) * static_cast<std::size_t>(k.width) +
                            static_cast<std::size_t>(u)];
      const double z = 1e-3 * mm;
      const Vec3 p = X_WC * Vec3((u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z);
      if ((p - centre).cwiseAbs().maxCoeff() > half) mm = 0;
    }
  }
}

void fuse_table(rt::NonRealtime& nrt, int edge, perception::TsdfMap& map) {
  SyntheticRoom far = furnished_room(), near = far;
  far.stride = 20;
  near.stride = 12;
  near.path = near_pose;
  auto frame = std::make_unique<RgbdFrame>();
  for (const SyntheticRoom* room : {&far, &near}) {
    const FusionSequence sequence = synthetic_sequence(nrt, *room, 14);
    for (int i = 0; i < sequence.size(); ++i) {
      sequence.frame(i, *frame);
      const Pose& X_WC = *sequence.truth(i);
      crop(X_WC, cube_centre(edge), 0.5 * kVoxel_m * edge, *frame);
      map.integrate(perception::FrameView::of(*frame), X_WC, 1);
    }
  }
}

}  // namespace

std::vector<Vec3> table_hand(double period_s, std::size_t ticks) {
  struct Leg {
    Vec3 to;
    double speed;
  };
  const double deep = 0.714, top = 0.753;  // 6 mm into the table, 7 mm into the book
  std::vector<Leg> legs{{{2.93, 0.60, deep}, 0.1},  {{2.93, 0.90, deep}, 0.2},
                        {{2.93, 0.70, deep}, 0.1},  {{2.99, 0.70, deep}, 0.1},
                        {{2.99, 0.73, deep}, 0.05}, {{2.95, 0.73, deep}, 0.1},
                        {{2.84, 0.73, deep}, 0.1},  {{2.84, 0.73, 0.78}, 0.1},
                        {{3.08, 0.72, 0.80}, 0.2},  {{3.08, 0.72, top}, 0.1}};
  for (int i = 1; i <= 48; ++i) {  // circles on the book
    const double a = 2 * std::numbers::pi * i / 24;
    legs.push_back({Vec3(3.05 + 0.03 * std::cos(a), 0.72 + 0.03 * std::sin(a), top), 0.1});
  }
  legs.push_back({{3.08, 0.72, 0.80}, 0.1});
  std::vector<Vec3> hand;
  Vec3 at(2.93, 0.60, 0.76);
  hand.push_back(at);
  for (const Leg& leg : legs) {
    const double length = (leg.to - at).norm();
    const auto n = static_cast<int>(std::ceil(length / (leg.speed * period_s)));
    for (int i = 1; i <= n; ++i) hand.push_back(at + (static_cast<double>(i) / n) * (leg.to - at));
    at = leg.to;
  }
  if (ticks > 0 && ticks < hand.size()) hand.resize(ticks);
  return hand;
}

TableRun record_table_run(rt::NonRealtime& nrt, int edge, std::size_t ticks, std::FILE* file) {
  perception::TsdfConfig tsdf;
  tsdf.voxel_size_m = kVoxel_m;
  tsdf.far_store_kib = 0;
  perception::TsdfMap map(nrt, tsdf);
  fuse_table(nrt, edge, map);

  HapticRunHeader header;
  header.device.damping_N_s_per_m = 20;
  header.config.credit_N_s_per_m = 2;
  tasks::HapticTask task(nrt, header.config, header.device, header.period_s);
  HapticRunWriter writer(file, header);
  std::array<std::unique_ptr<SurfacePatch>, 8> windows;
  for (auto& w : windows) w = std::make_unique<SurfacePatch>();
  std::size_t at = 0;
  std::uint64_t published = 0;
  TableRun result;
  result.blocks = map.block_count();
  const auto hand = table_hand(header.period_s, ticks);
  tasks::HapticTask::In in;
  tasks::HapticTask::Out out;
  in.mode.seq = 1;
  in.mode.mode = tasks::Mode::kHold;
  in.stylus_ok = true;
  in.stylus.state = drivers::DeviceState::kForce;
  for (std::size_t k = 0; k < hand.size(); ++k) {
    const double t = header.period_s * static_cast<double>(k);
    const rt::Time now = rt::time_from_ns(0) + rt::nanos_from_seconds(t);
    if (std::floor(t * 30 + 1e-9) >= static_cast<double>(published)) {
      at = (at + 1) % windows.size();
      SurfacePatch& w = *windows[at];
      const Vec3 v = k > 0 ? Vec3((hand[k] - hand[k - 1]) / header.period_s) : Vec3::Zero();
      perception::copy_patch(map, hand[k] + v * (2.0 / 30), SurfacePatch::kMaxNodes, w);
      w.seq = ++published;
      w.fused = w.exposure = now;
      writer.window(w);
    }
    in.patch_newest = task.wants_patch() ? windows[at].get() : nullptr;
    in.stylus.seq = k + 1;
    in.stylus.taken = now;
    in.stylus.p_DH = hand[k];
    rt::Tick tick;
    tick.k = k;
    tick.release = tick.start = now;
    tick.period = rt::nanos_from_seconds(header.period_s);
    (void)task.step(tick, in, out);
    writer.tick(run_tick(tick, in, out));
    result.ticks += 1;
    result.contact += out.telemetry.in_contact ? 1 : 0;
  }
  writer.finish();
  return result;
}

}  // namespace teletact

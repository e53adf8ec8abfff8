#include "tools/measure/bench/table2/followed.hpp"
#include "rt/clock/box_time.hpp"

#include <algorithm>
#include <optional>

#include "perception/tsdf/blocks/map_reader.hpp"

namespace teletact {
namespace {

using perception::Image;
using perception::Pose;
using perception::Vec3;

constexpr int kFramesOfOne = 12;  // with the first object alone
constexpr int kTurns = 5;         // of each object, with all of them

double cpu_ms() { return 1e-6 * static_cast<double>(rt::thread_cpu_ns()); }

perception::TsdfConfig map_config() {
  perception::TsdfConfig c;
  c.max_blocks = 16384;
  c.max_chunks = 1024;
  return c;
}

perception::ObjectsConfig objects_config() {
  perception::ObjectsConfig c;
  c.enabled = true;
  return c;
}

bool reads(std::uint16_t mm) { return mm != 0 && mm != 65535; }

}  // namespace

struct FollowedObjects::Impl {
  rt::Startup startup;
  perception::Intrinsics k;
  float mm_per_unit;
  perception::TsdfMap map;
  perception::ObjectMap objects;
  Image<std::uint16_t> depth_mm;
  perception::FrameView frame;

  Impl(const perception::Intrinsics& intrinsics, float scale)
      : k(intrinsics),
        mm_per_unit(scale),
        map(startup.token(), map_config()),
        objects(startup.token(), k.width, k.height, objects_config()),
        depth_mm(k.width, k.height) {}

  [[nodiscard]] Vec3 point(int u, int v) const {
    return k.unproject(u, v, 1e-3 * depth_mm.at(u, v));
  }
  // One frame; returns what objects cost in it.
  double step(const std::optional<Vec3>& touched) {
    const Pose X_WC = Pose::Identity();
    static_cast<void>(map.integrate(frame, X_WC, 2));
    const double begin = cpu_ms();
    objects.segment(frame, map, X_WC, touched);
    objects.fuse(map);
    return cpu_ms() - begin;
  }
  [[nodiscard]] double iou(const Image<std::uint16_t>& label, std::uint16_t object,
                           std::uint8_t id) const {
    perception::MapReader reader(map);
    double both = 0, either = 0;
    for (int v = 0; v < k.height; ++v)
      for (int u = 0; u < k.width; ++u) {
        if (label.at(u, v) == 65535 || !reads(depth_mm.at(u, v))) continue;
        const bool a = label.at(u, v) == object, b = reader.label(point(u, v)) == id;
        both += a && b ? 1 : 0;
        either += a || b ? 1 : 0;
      }
    return either > 0 ? both / either : 0;
  }
};

FollowedObjects::FollowedObjects(const perception::Intrinsics& k, float mm_per_unit)
    : impl_(std::make_unique<Impl>(k, mm_per_unit)) {}
FollowedObjects::~FollowedObjects() = default;

FollowedRun FollowedObjects::run(perception::ImageView<const perception::Rgb> rgb,
                                 perception::ImageView<const std::uint16_t> depth,
                                 const Image<std::uint16_t>& label,
                                 const std::vector<Touch>& touches) {
  Impl& m = *impl_;
  for (int v = 0; v < m.k.height; ++v)
    for (int u = 0; u < m.k.width; ++u) {
      const auto raw = static_cast<float>(depth.at(u, v));
      m.depth_mm.at(u, v) = reads(depth.at(u, v))
                                ? static_cast<std::uint16_t>(raw * m.mm_per_unit + 0.5F)
                                : std::uint16_t{0};
    }
  m.frame = {m.k, m.depth_mm.view(), rgb};
  m.map.clear();
  m.objects.clear();
  for (int i = 0; i < 3; ++i) static_cast<void>(m.step({}));
  FollowedRun run;
  std::vector<std::pair<std::uint16_t, std::uint8_t>> named;
  for (const Touch& t : touches) {
    if (!reads(m.depth_mm.at(t.u, t.v))) continue;
    const double ms = m.step(m.point(t.u, t.v));
    if (m.objects.stats().answer != perception::TouchAnswer::kObject) continue;
    run.touch_ms.push_back(ms);
    named.emplace_back(t.object, m.objects.stats().touched);
    for (int i = 0; named.size() == 1 && i < kFramesOfOne; ++i) run.one_ms.push_back(m.step({}));
  }
  if (named.empty()) return run;
  const int frames = kTurns * static_cast<int>(named.size());
  for (int i = 0; i < frames; ++i) run.all_mean_ms += m.step({}) / frames;
  for (const double ms : run.one_ms) run.one_mean_ms += ms / kFramesOfOne;
  for (const auto& [object, id] : named) {
    run.objects += m.objects.objects()[id - 1U].id == id ? 1 : 0;
    run.iou.push_back(m.iou(label, object, id));
  }
  return run;
}

}  // namespace teletact

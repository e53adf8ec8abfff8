#include "tools/teletact/touch_sources.hpp"

#include <cstdio>
#include <string>

#include "tools/teletact/field_window.hpp"

namespace teletact::touch {

using perception::Vec3;

namespace {

View parse_view(const std::string& text) {
  View out;
  Vec3 &e = out.eye, &l = out.look;
  int used = 0;
  const int n = std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf%n", &e.x(), &e.y(), &e.z(),
                            &l.x(), &l.y(), &l.z(), &used);
  check(n == 6 && static_cast<std::size_t>(used) == text.size() && e.allFinite() && l.allFinite() &&
            e.norm() < 1e6 && l.norm() < 1e6 && (e - l).norm() > 1e-6,
        "--view '" + text + "': six finite numbers, eye x,y,z and look x,y,z in metres, apart");
  return out;
}

}  // namespace

WindowSource::WindowSource(const FieldList& fields, const Options& o, const Vec3& origin)
    : fields_(fields), options_(o), origin_(origin) {
  for (auto& slot : slots_) slot = std::make_unique<perception::SurfacePatch>();
}

const perception::SurfacePatch* WindowSource::at(double t, rt::Time now, const Vec3& hand,
                                                 const Vec3& velocity, bool wanted) {
  const std::size_t field = fields_.visible(t, visible_);
  if (field == 0) return nullptr;
  const bool other = field != visible_;
  if (other || t >= next_ - 1e-9) {
    visible_ = field;
    constexpr double kPeriod_s = 1.0 / 30.0;
    next_ = (other || seq_ == 0 ? t : next_) + kPeriod_s;
    ++seq_;
    fused_ = now;
    centre_ = hand + velocity * (2 * kPeriod_s) - origin_;
  }
  if (!wanted) return nullptr;
  if (slots_[current_]->seq != seq_) {
    current_ = (current_ + 1) % slots_.size();
    perception::SurfacePatch& patch = *slots_[current_];
    patch.seq = seq_;
    patch.fused = patch.exposure = fused_;
    patch.palette = fields_.palette;
    fill_window(fields_.fields[visible_ - 1], centre_, options_.voxel_m, options_.truncation_m,
                options_.window_nodes, patch);
  }
  return slots_[current_].get();
}

SurfaceSource::SurfaceSource(const FieldList& fields, const Options& o, const Vec3& origin,
                             const std::vector<HandRow>& hand)
    : fields_(fields), options_(o) {
  wanted_ = o.method == "force_shading";
  check(wanted_ || o.view.empty(), "--view: only the method force_shading has a view");
  if (!wanted_) return;
  if (!o.view.empty()) {
    view_ = parse_view(o.view);
    view_.eye -= origin;
    view_.look -= origin;
    return;
  }
  FirstContact first;
  std::size_t visible = 0;
  for (const HandRow& row : hand) {
    visible = fields.visible(row.t, visible);
    if (visible == 0) continue;
    const auto view = first.at(fields.fields[visible - 1], o.voxel_m, row.p - origin);
    if (!view) continue;
    view_ = *view;
    break;
  }
}

const tasks::SurfacePoints* SurfaceSource::at(std::size_t visible) {
  if (!wanted_ || visible == 0 || visible == cast_) return nullptr;
  cast_ = visible;
  current_ = 1 - current_;
  seen_ = cast_view(fields_.fields[visible - 1], options_.voxel_m, view_, points_[current_]) > 0 ||
          seen_;
  return &points_[current_];
}

void SurfaceSource::check_seen() const {
  check(!wanted_ || options_.view.empty() || cast_ == 0 || seen_,
        "--view '" + options_.view + "': no surface is seen from there");
}

}  // namespace teletact::touch

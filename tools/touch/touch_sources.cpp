#include "tools/touch/touch_sources.hpp"

#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "tools/touch/field_window.hpp"

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

std::string box_text(const Vec3& low, const Vec3& high) {
  char text[160];
  std::snprintf(text, sizeof text, "%.4g,%.4g,%.4g to %.4g,%.4g,%.4g m", low.x(), low.y(), low.z(),
                high.x(), high.y(), high.z());
  return text;
}

}  // namespace

WindowSource::WindowSource(const FieldList& fields, const Options& o, const Vec3& origin)
    : fields_(fields), options_(o), origin_(origin) {
  for (auto& slot : slots_) slot = std::make_unique<perception::SurfacePatch>();
}

const perception::SurfacePatch* WindowSource::at(double t, rt::Time now, const Vec3& hand,
                                                 const Vec3& velocity, bool wanted) {
  low_ = low_.cwiseMin(hand);
  high_ = high_.cwiseMax(hand);
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
  met_ = met_ || known_round(hand - origin_);
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

// Any node of the cell that p lies in.
bool WindowSource::known_round(const Vec3& p) const {
  const DenseField& field = fields_.fields[visible_ - 1];
  std::array<std::size_t, 3> at{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double i = std::floor(p[static_cast<Eigen::Index>(a)] / options_.voxel_m);
    if (!(i >= 0 && i < field.size[a])) return false;
    at[a] = static_cast<std::size_t>(i);
  }
  for (std::size_t corner = 0; corner < 8; ++corner) {
    std::size_t node = 0;
    bool inside = true;
    for (std::size_t a = 0; a < 3; ++a) {
      const std::size_t i = at[a] + (corner >> a & 1U);
      inside = inside && i < static_cast<std::size_t>(field.size[a]);
      node = node * static_cast<std::size_t>(field.size[a]) + i;
    }
    if (inside && !std::isnan(field.distance[node])) return true;
  }
  return false;
}

void WindowSource::check_met(const std::vector<HandRow>& hand, bool touched) const {
  if (met_ || touched) return;
  const std::string name = options_.field.empty() ? options_.fields : options_.field;
  if (visible_ == 0) {
    char text[96];
    std::snprintf(text, sizeof text, ": no field before t_s %g, and the path ends at %g",
                  fields_.from.front(), hand.back().t);
    throw std::runtime_error(name + text);
  }
  const auto& size = fields_.fields[visible_ - 1].size;
  const Vec3 last = options_.voxel_m * Vec3(size[0] - 1, size[1] - 1, size[2] - 1);
  throw std::runtime_error(name + ": not known anywhere on the path: the field reaches from " +
                           box_text(origin_, origin_ + last) + ", the hand from " +
                           box_text(low_, high_));
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

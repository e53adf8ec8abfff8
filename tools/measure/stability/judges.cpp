#include "tools/measure/stability/judges.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace stability {

using rig::Row;
using rig::Vec3;

namespace {

constexpr double kForceLimit_N = 12;

Vec3 cut(const Vec3& f) {
  const double size = f.norm();
  return size > kForceLimit_N ? Vec3(f * (kForceLimit_N / size)) : f;
}

// Evenly over the sphere.
Vec3 direction(int k, int count = 96) {
  const double z = (2 * k + 1.0) / count - 1, angle = 2.399963 * k, r = std::sqrt(1 - z * z);
  return {r * std::cos(angle), r * std::sin(angle), z};
}

// How far p is from the free along `way`; `most` where it is farther.
double to_free_m(const support::ReferenceField& field, const Vec3& p, const Vec3& way,
                 double radius_m, double most) {
  constexpr double kStep_m = 5e-5;
  const auto free = [&](double s) { return field(p + s * way) >= radius_m; };
  for (double in = 0; in < most; in += kStep_m) {
    double out = std::min(in + kStep_m, most), solid = in;
    if (!free(out)) continue;
    for (int i = 0; i < 16; ++i) {
      const double middle = 0.5 * (solid + out);
      (free(middle) ? out : solid) = middle;
    }
    return out;
  }
  return most;
}

// Energy of a spring whose force is cut.
double held_J(double stiffness, double stretch) {
  const double knee = kForceLimit_N / stiffness;
  return stretch <= knee ? 0.5 * stiffness * stretch * stretch
                         : kForceLimit_N * (stretch - 0.5 * knee);
}

}  // namespace

std::vector<Vec3> forces_of(std::span<const Row> rows) {
  std::vector<Vec3> out;
  out.reserve(rows.size());
  for (const Row& row : rows) out.push_back(row.f);
  return out;
}

double chatter_N(std::span<const Vec3> force) {
  constexpr std::size_t kSettling = 50;
  if (force.size() <= kSettling) return 0;
  const double w = std::tan(std::numbers::pi * 100 / 1000), norm = 1 + std::sqrt(2.0) * w + w * w;
  const double a1 = 2 * (w * w - 1) / norm, a2 = (1 - std::sqrt(2.0) * w + w * w) / norm;
  Vec3 x1 = Vec3::Zero(), x2 = x1, y1 = x1, y2 = x1;
  double sum = 0;
  for (std::size_t i = 0; i < force.size(); ++i) {
    const Vec3 x = force[i] - force[0];
    const Vec3 y = (x - 2 * x1 + x2) / norm - a1 * y1 - a2 * y2;
    x2 = std::exchange(x1, x);
    y2 = std::exchange(y1, y);
    if (i >= kSettling) sum += y.squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(force.size() - kSettling));
}

Worst worst_of(const Run& run, const Setting& s, const Figure& figure) {
  constexpr double kNear_m = 1e-3, kGuardTicks = kForceLimit_N / 0.3;
  const double near = kNear_m / (1e-3 * s.speed);  // ticks
  Worst out;
  std::vector<Pair>
      places;  // row and the optimum's figure there, or its guarded force's: a force that turns slowly is short
  for (const rig::Optimum& o : run.optimum) {
    const Vec3& h = run.rows[o.row].h;
    const double best = figure(h, o.p, o.f), guarded = figure(h, o.p, o.f_guarded);
    if (std::isnan(best)) continue;
    out.optimum = std::max(out.optimum, best);
    places.push_back({static_cast<double>(o.row), guarded > best ? guarded : best});
  }
  if (run.optimum.empty()) out.optimum = std::nan("");
  const auto take = [&](std::size_t i, std::size_t& from) {
    const Row& row = run.rows[i];
    const double mine = figure(row.h, row.p, row.f), at = static_cast<double>(i);
    if (std::isnan(mine)) return;
    out.ours = std::max(out.ours, mine);
    while (from < places.size() && places[from].ours < at - near - kGuardTicks) ++from;
    Pair here{mine, std::nan("")};
    for (std::size_t k = from; k < places.size() && places[k].ours <= at + near; ++k) {
      if (!(places[k].optimum <= here.optimum)) here.optimum = places[k].optimum;
    }
    if (!std::isnan(here.optimum)) out.each.push_back(here);
  };
  std::size_t from = 0;
  if (s.fused != nullptr) {
    for (const rig::Optimum& o : run.optimum) take(o.row, from);
  } else {
    for (std::size_t i = 0; i < run.rows.size(); ++i) take(i, from);
  }
  return out;
}

Pair farthest_alone(std::span<const Pair> each, double limit) {
  Pair out;
  for (const Pair& p : each) {
    if (p.ours <= limit + 1e-9 || Check::as_far(p.ours, p.optimum, limit)) continue;
    if (!(p.ours <= out.ours)) out = p;
  }
  return out;
}

void add(Run& run, std::string name, const Worst& worst, double limit) {
  add(run, std::move(name), worst.ours, limit, worst.optimum);
  run.checks.back().alone = farthest_alone(worst.each, limit);
}

void add_pops(Run& run, const rig::Rig& r, bool side) {
  add(run, "sunk ticks", static_cast<double>(r.pops().sunk()), 0);
  if (side) add(run, "turned to the other side", static_cast<double>(r.pops().flipped()), 0);
}

Injected injected(std::span<const Row> rows, double stiffness) {
  constexpr std::size_t kWindow = 100;  // ticks
  Injected out;
  std::vector<double> in(rows.size(), 0);
  std::vector<double> going(rows.size(), 0);  // of blend or fade in this tick
  double fastest_blend = 0, fastest_fade = 0;
  Vec3 f_last = Vec3::Zero();
  double held_last = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    const double gain = row.telemetry.in_contact ? row.telemetry.gain : 0;
    const Vec3 f = cut(gain * stiffness * (row.p - row.h));
    const double held = gain > 0 ? held_J(gain * stiffness, (row.p - row.h).norm()) : 0;
    if (i > 0) {
      const tasks::HapticTelemetry &now = row.telemetry, &before = rows[i - 1].telemetry;
      in[i] = std::max(0.0, held - held_last + 0.5 * (f + f_last).dot(row.h - rows[i - 1].h));
      out.sum_J += in[i];
      out.booked_J += std::max(0.0, now.booked_J - before.booked_J);
      fastest_blend = std::max(fastest_blend, now.blend - before.blend);
      fastest_fade = std::max(fastest_fade, now.gain - before.gain);
    }
    f_last = f;
    held_last = held;
  }
  double event = 0, window = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const tasks::HapticTelemetry &now = rows[i].telemetry, &before = rows[i - 1].telemetry;
    const bool fresh = now.blend < before.blend;
    if (fresh && (before.gain <= 0 || before.gain >= 1)) event = 0;
    event += in[i];
    window += in[i] - (i >= kWindow ? in[i - kWindow] : 0);
    out.whole_event_J = std::max(out.whole_event_J, event);
    const double blend = now.blend - (fresh ? 0 : before.blend);
    const bool full = (blend > 0.5 * fastest_blend && fastest_blend > 0) ||
                      (now.gain - before.gain > 0.5 * fastest_fade && fastest_fade > 0);
    if (!full || in[i] <= 0) continue;
    out.event_J = std::max(out.event_J, event);
    out.power_J = std::max(out.power_J, window);
  }
  return out;
}

void add_injected(Run& run, double stiffness) {
  const Injected in = injected(run.rows, stiffness);
  add(run, "booked at full rate mJ an event", 1e3 * in.event_J, 50);
  add(run, "booked at full rate mJ in 100 ms", 1e3 * in.power_J, 100);
  add(run, "not booked mJ", 1e3 * (in.sum_J - in.booked_J), 1);
}

Worst reversals(const Run& run) {
  Worst out;
  const auto turned = [](const Vec3& a, const Vec3& b) {
    return a.norm() > 0.1 && b.norm() > 0.1 && a.dot(b) < 0;
  };
  for (std::size_t i = 1; i < run.rows.size(); ++i) {
    out.ours += turned(run.rows[i - 1].f_raw, run.rows[i].f_raw) ? 1 : 0;
  }
  if (run.optimum.empty()) out.optimum = std::nan("");
  for (std::size_t i = 1; i < run.optimum.size(); ++i) {
    out.optimum += turned(run.optimum[i - 1].f, run.optimum[i].f) ? 1 : 0;
  }
  return out;
}

int buzz_ticks(std::span<const Row> rows, double least_N) {
  int out = 0;
  for (std::size_t i = 2; i < rows.size(); ++i) {
    const Vec3 step = rows[i].f_raw - rows[i - 1].f_raw,
               last = rows[i - 1].f_raw - rows[i - 2].f_raw;
    const double size = step.norm(), before = last.norm();
    if (size > least_N && before > least_N && step.dot(last) < -0.5 * size * before) ++out;
  }
  return out;
}

int longest_inside(std::span<const Row> rows, double radius) {
  constexpr double kIn_m = 2e-5;
  int longest = 0, now = 0;
  for (const Row& row : rows) {
    now = row.depth_m + radius > kIn_m ? now + 1 : 0;  // NaN: free
    longest = std::max(longest, now);
  }
  return longest;
}

double off_zero_set_m(const support::ReferenceField& field, const Vec3& p_W, double radius_m) {
  constexpr double kStep_m = 5e-5, kFarthest_m = 3e-3;
  const double here = field(p_W) - radius_m;
  if (std::abs(here) < 1e-7) return 0;
  for (double r = kStep_m; r < kFarthest_m; r += kStep_m) {
    for (int k = 0; k < 96; ++k) {
      if ((field(p_W + r * direction(k)) - radius_m) * here <= 0) return r;
    }
  }
  return kFarthest_m;
}

Vec3 nearest_free(const support::ReferenceField& field, const Vec3& p_W, double radius_m) {
  constexpr double kFarthest_m = 3e-3, kGain_m = 1e-9;
  constexpr int kDirections = 400;
  if (field(p_W) >= radius_m) return p_W;
  double least = kFarthest_m;
  Vec3 way = Vec3::Zero();
  const auto attempt = [&](const Vec3& d) {
    const double s = to_free_m(field, p_W, d, radius_m, least);
    if (s >= least - kGain_m) return false;
    least = s;
    way = d;
    return true;
  };
  for (int k = 0; k < kDirections; ++k) attempt(direction(k, kDirections));
  if (way.isZero()) return p_W;
  for (double turn = 0.1; turn > 2e-3; turn *= 0.5) {
    bool nearer = true;
    while (nearer) {
      nearer = false;
      // attempt() moves way. NOLINTNEXTLINE(performance-unnecessary-copy-initialization)
      const Vec3 middle = way, a = middle.unitOrthogonal(), b = middle.cross(a);
      for (int k = 0; k < 8; ++k) {
        const double angle = 0.25 * std::numbers::pi * k;
        const Vec3 aside = std::cos(angle) * a + std::sin(angle) * b;
        nearer = attempt((middle + turn * aside).normalized()) || nearer;
      }
    }
  }
  return p_W + least * way;
}

double off_zero_set_m(const rig::Rig& r, const std::vector<Row>& rows, std::size_t stride) {
  const support::ReferenceField field = rig::reference_field(r, rows);
  double most = 0;
  for (std::size_t i = 0; i < rows.size(); i += stride) {
    if (!rows[i].telemetry.in_contact) continue;
    const Vec3 p_W = r.setup().X_WS * rows[i].p;
    if (!rig::in_known(r.setup(), p_W)) continue;
    most = std::max(most, off_zero_set_m(field, p_W, r.setup().config.tip_radius_m));
  }
  return most;
}

std::vector<Vec3> groove_line(const rig::Rig& r, const std::vector<Row>& rows, double top_m) {
  constexpr double kCell = 2.5e-4;
  constexpr int kHalf = 48;  // 12 mm to either side
  const support::ReferenceField field = rig::reference_field(r, rows);
  const double radius = r.setup().config.tip_radius_m;
  double least_y = 1e9, most_y = -1e9;
  for (const Row& row : rows) {
    least_y = std::min(least_y, row.p.y());
    most_y = std::max(most_y, row.p.y());
  }
  const int deep = static_cast<int>(std::ceil((top_m + 0.005) / kCell));
  constexpr int kWide = 2 * kHalf + 1;
  std::vector<Vec3> line;
  for (double y = least_y - 2e-3; y <= most_y + 2e-3; y += 1e-3) {
    std::vector<char> seen(static_cast<std::size_t>(kWide * deep), 0);
    std::vector<std::pair<int, int>> open{{kHalf, 0}};
    Vec3 lowest(0, y, top_m);
    while (!open.empty()) {
      const auto [u, v] = open.back();
      open.pop_back();
      if (u < 0 || u >= kWide || v < 0 || v >= deep) continue;
      char& mark = seen[static_cast<std::size_t>(v * kWide + u)];
      if (mark != 0) continue;
      mark = 1;
      const Vec3 p((u - kHalf) * kCell, y, top_m - v * kCell);
      if (field(r.setup().X_WS * p) <= radius) continue;
      if (p.z() < lowest.z()) lowest = p;
      open.insert(open.end(), {{u + 1, v}, {u - 1, v}, {u, v + 1}, {u, v - 1}});
    }
    line.push_back(lowest);
  }
  return line;
}

double off_line_m(const std::vector<Vec3>& line, const Vec3& p) {
  double least = 1e9;
  for (std::size_t i = 1; i < line.size(); ++i) {
    const Vec3 way = line[i] - line[i - 1];
    const double t = std::clamp((p - line[i - 1]).dot(way) / way.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (p - line[i - 1] - t * way).norm());
  }
  return least;
}

void add_fade_in(Run& run, double full_N) {
  double full = 1, wrong = 0;
  const double from = run.rows.front().t;
  for (const Row& row : run.rows) {
    wrong = std::max(wrong, -row.f.z());
    if (full == 1 && row.f.z() > full_N - 0.05) full = row.t - from;
  }
  add(run, "J N", std::max(run.figures.j, run.rows.front().f.norm()), 0.3);
  add(run, "full force ms", 1e3 * full, 100);
  add(run, "30 ms less it", 30 - 1e3 * full, 0);
  add(run, "wrong side N", wrong, 1e-9);
  add(run, "end force error N", (run.rows.back().f - Vec3(0, 0, full_N)).norm(), 0.05);
}

Vec3 FrictionModel::follow(const Vec3& p_c, const Vec3& h) {
  const Vec3 out = p_c - h;
  const double d = out.norm();
  if (d < 1e-6) {
    leave();
    return p_c;
  }
  if (!touching_) {
    touching_ = true;
    slipping_ = false;
    anchor_ = p_c;
  }
  const Vec3 n = out / d, away = anchor_ - p_c;
  Vec3 t = away - away.dot(n) * n;
  const double length = t.norm();
  if (slipping_ && length < mu_d_ * d - 1e-6) slipping_ = false;
  if (length > (slipping_ ? mu_d_ : mu_s_) * d) {
    slipping_ = true;
    t *= mu_d_ * d / length;
    anchor_ = p_c + t;
  }
  return p_c + t;
}

}  // namespace stability

#include "tools/robot/drive_problem.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "perception/geometry/pose.hpp"

namespace teletact {

using perception::Pose;
using perception::Pose2;
using perception::Vec3;

namespace {

constexpr double kHuberCamera = 4,
                 kHuberWheels = 3;  // of the whitened length: 99 % of 6 and of 3 dimensions
constexpr double kOut = 6;          // farther off: left out
constexpr double kStep = 1e-5;      // of the differences: rounding and cubic term are alike there
// Below these no noise is believed: encoder steps, rounded files.
constexpr DriveNoise kLeast{5e-5, 5e-5, 1e-4};
constexpr double kWheelFloor_m = 1e-4, kWheelFloor_rad = 1.5e-4;
// An interval that moved less says nothing of the slip.
constexpr double kMoved_m = 0.02, kMoved_rad = 0.04;

perception::Mat3 turned(const Vec3& w) {
  const double angle = w.norm();
  if (angle < 1e-15) return perception::Mat3::Identity();
  return Eigen::AngleAxisd(angle, w / angle).toRotationMatrix();
}

Vec3 turn_of(const perception::Mat3& R) {
  const Eigen::AngleAxisd a(R);
  return a.angle() * a.axis();
}

// What is stated is right to ten limits (10 %, 0.2 m, 10 degrees): holds what no data hold, and
// takes 1e-3 of what they say. The height only the floor tells: to 2 m.
double prior_of(std::size_t i) {
  const auto p = static_cast<RobotParameter>(i);
  return (p == RobotParameter::kZ ? 100 : 10) * limit_of(p);
}

double huber(double length, double limit) {
  return length <= limit ? length * length : 2 * limit * length - limit * limit;
}

}  // namespace

Pose pose_on_floor(const Pose2& p) {
  Pose X = Pose::Identity();
  X.linear() = perception::rotation_about_z(p.yaw);
  X.translation() = Vec3(p.x, p.y, 0);
  return X;
}

Eigen::Matrix4d wheel_patterns() {
  Eigen::Matrix4d m;  // rows: front left, front right, back left, back right
  m << 1, 1, 1, 1, 1, -1, 1, -1, 1, 1, -1, -1, 1, -1, -1, 1;
  return m;
}

drivers::MecanumConfig changed_base(const drivers::MecanumConfig& stated,
                                    const DriveProblem::Parameters& change) {
  static const Eigen::Matrix4d patterns = wheel_patterns();
  drivers::MecanumConfig c = stated;
  const Eigen::Vector4d share = patterns * change.head<4>();
  for (int i = 0; i < drivers::kWheels; ++i) c.wheel_scale[i] *= 1 + share[i];
  c.lever_scale *= 1 + change[4];
  c.slide_scale *= 1 + change[5];
  return c;
}

Pose changed_mount(const Pose& X_BC, const DriveProblem::Parameters& change) {
  Pose X = X_BC;
  X.translation() += change.segment<3>(6);
  X.linear() = turned(change.segment<3>(9)) * X_BC.linear();
  return X;
}

DriveProblem::DriveProblem(const RobotModel& stated, std::vector<DriveInstant> instants,
                           std::vector<DriveInterval> intervals, const DriveFloor& floor,
                           DriveNoise noise)
    : stated_(stated),
      instants_(std::move(instants)),
      intervals_(std::move(intervals)),
      floor_(floor),
      noise_(noise) {
  // From the camera alone, as its stated mount has it.
  const Pose X_CB = stated.X_BC.inverse();
  state_.X_WP = instants_.front().X_WC * X_CB;
  const Pose X_PW = state_.X_WP.inverse();
  for (const DriveInstant& k : instants_) {
    const Pose X = X_PW * k.X_WC * X_CB;
    state_.X_PB.push_back(
        {X.translation().x(), X.translation().y(), std::atan2(X.linear()(1, 0), X.linear()(0, 0))});
  }
  state_.X_PB.front() = {};
  for (int k = 0; k < static_cast<int>(instants_.size()); ++k) {
    Factor f;
    f.kind = Kind::kCamera;
    f.of = k;
    for (int i = 6; i < 18; ++i) f.index.push_back(i);
    for (int i = 0; k > 0 && i < 3; ++i) f.index.push_back(18 + 3 * (k - 1) + i);
    factors_.push_back(std::move(f));
  }
  for (int n = 0; n < static_cast<int>(intervals_.size()); ++n) {
    Factor f;
    f.kind = Kind::kWheels;
    f.of = n;
    for (int i = 0; i < 6; ++i) f.index.push_back(i);
    const DriveInterval& at = intervals_[static_cast<std::size_t>(n)];
    for (const int k : {at.from, at.to}) {
      for (int i = 0; k > 0 && i < 3; ++i) f.index.push_back(18 + 3 * (k - 1) + i);
    }
    factors_.push_back(std::move(f));
  }
  if (floor_.seen) {
    Factor f;
    f.kind = Kind::kFloor;
    for (int i = 6; i < 12; ++i) f.index.push_back(i);
    factors_.push_back(std::move(f));
  }
}

Pose2 DriveProblem::driven(const DriveInterval& i, const Parameters& change) const {
  const drivers::Mecanum kinematics(changed_base(stated_.base, change));
  Pose2 d;
  for (const auto& step : i.steps)
    d = perception::compose(d, perception::exp_se2(kinematics.forward(step)));
  return d;
}

// ---- How far off each factor is, whitened

Eigen::Matrix<double, 6, 1> DriveProblem::camera_off(int k, const Parameters& change,
                                                     const Pose& X_WP, const Pose2& X_PB) const {
  const Pose X_WC = X_WP * pose_on_floor(X_PB) * changed_mount(stated_.X_BC, change);
  const Pose E = X_WC.inverse() * instants_[static_cast<std::size_t>(k)].X_WC;
  Eigen::Matrix<double, 6, 1> r;
  r << E.translation() / noise_.camera_m, turn_of(E.linear()) / noise_.camera_rad;
  return r;
}

Eigen::Vector3d DriveProblem::wheels_off(const DriveInterval& i, const Pose2& d,
                                         const State& s) const {
  const Pose2 seen =
      perception::compose(perception::inverse(s.X_PB[static_cast<std::size_t>(i.from)]),
                          s.X_PB[static_cast<std::size_t>(i.to)]);
  const Pose2 e = perception::compose(perception::inverse(d), seen);
  return whitening_[static_cast<std::size_t>(&i - intervals_.data())] *
         Eigen::Vector3d(e.x, e.y, e.yaw);
}

Eigen::Vector3d DriveProblem::floor_off(const Parameters& change) const {
  const Pose X_BC = changed_mount(stated_.X_BC, change);
  const Vec3 up_B = X_BC.linear() * floor_.up_C;
  return {up_B.x() / floor_.sigma_rad, up_B.y() / floor_.sigma_rad,
          (floor_.height_m - X_BC.translation().z()) / floor_.sigma_m};
}

Eigen::VectorXd DriveProblem::residual(const Factor& f, const State& s) const {
  if (f.kind == Kind::kFloor) return floor_off(s.change);
  if (f.kind == Kind::kCamera)
    return camera_off(f.of, s.change, s.X_WP, s.X_PB[static_cast<std::size_t>(f.of)]);
  const DriveInterval& i = intervals_[static_cast<std::size_t>(f.of)];
  return wheels_off(i, driven(i, s.change), s);
}

// A slip is a radius of that interval alone.
void DriveProblem::whiten_wheels() {
  static const Eigen::Matrix4d shares = wheel_patterns().inverse();
  constexpr double kShare = 1e-4;
  whitening_.clear();
  for (const DriveInterval& i : intervals_) {
    const Pose2 back = perception::inverse(driven(i, state_.change));
    Eigen::Matrix<double, 3, 4> J;
    for (int w = 0; w < drivers::kWheels; ++w) {
      Parameters more = state_.change;
      more.head<4>() += kShare * shares.col(w);
      const Pose2 e = perception::compose(back, driven(i, more));
      J.col(w) = Eigen::Vector3d(e.x, e.y, e.yaw) / kShare;
    }
    Eigen::Matrix3d C = noise_.slip * noise_.slip * J * J.transpose();
    C.diagonal() += Eigen::Vector3d(kWheelFloor_m * kWheelFloor_m, kWheelFloor_m * kWheelFloor_m,
                                    kWheelFloor_rad * kWheelFloor_rad);
    const Eigen::Matrix3d L = C.llt().matrixL();
    whitening_.push_back(
        L.triangularView<Eigen::Lower>().solve(Eigen::Matrix3d::Identity()).eval());
  }
}

// ---- Derivatives, by central differences

void DriveProblem::linearise_camera(Factor& f) const {
  const Pose2& X_PB = state_.X_PB[static_cast<std::size_t>(f.of)];
  f.r = camera_off(f.of, state_.change, state_.X_WP, X_PB);
  f.J.resize(6, static_cast<Eigen::Index>(f.index.size()));
  for (std::size_t c = 0; c < f.index.size(); ++c) {
    Eigen::Matrix<double, 6, 1> side[2];
    for (int n = 0; n < 2; ++n) {
      const double h = n == 0 ? kStep : -kStep;
      Parameters change = state_.change;
      Pose X_WP = state_.X_WP;
      Pose2 X = X_PB;
      if (c < 6) {
        change[static_cast<Eigen::Index>(6 + c)] += h;
      } else if (c < 9) {
        X_WP.translation()[static_cast<Eigen::Index>(c - 6)] += h;
      } else if (c < 12) {
        X_WP.linear() = turned(h * Vec3::Unit(static_cast<Eigen::Index>(c - 9))) * X_WP.linear();
      } else {
        (c == 12 ? X.x : c == 13 ? X.y : X.yaw) += h;
      }
      side[n] = camera_off(f.of, change, X_WP, X);
    }
    f.J.col(static_cast<Eigen::Index>(c)) = (side[0] - side[1]) / (2 * kStep);
  }
}

void DriveProblem::linearise_wheels(Factor& f) const {
  const DriveInterval& i = intervals_[static_cast<std::size_t>(f.of)];
  const Pose2 d = driven(i, state_.change);
  f.r = wheels_off(i, d, state_);
  f.J.resize(3, static_cast<Eigen::Index>(f.index.size()));
  for (std::size_t c = 0; c < f.index.size(); ++c) {
    Eigen::Vector3d side[2];
    for (int n = 0; n < 2; ++n) {
      const double h = n == 0 ? kStep : -kStep;
      if (c < 6) {
        Parameters change = state_.change;
        change[static_cast<Eigen::Index>(c)] += h;
        side[n] = wheels_off(i, driven(i, change), state_);
      } else {
        // Of the two poses the later one alone if the earlier one is the first.
        const bool earlier = i.from > 0 && c < 9;
        const Pose2& was = state_.X_PB[static_cast<std::size_t>(earlier ? i.from : i.to)];
        Pose2 X = was;
        const std::size_t axis = (c - 6) % 3;
        (axis == 0 ? X.x : axis == 1 ? X.y : X.yaw) += h;
        const Pose2& other = state_.X_PB[static_cast<std::size_t>(earlier ? i.to : i.from)];
        const Pose2 seen = earlier ? perception::compose(perception::inverse(X), other)
                                   : perception::compose(perception::inverse(other), X);
        const Pose2 e = perception::compose(perception::inverse(d), seen);
        side[n] = whitening_[static_cast<std::size_t>(f.of)] * Eigen::Vector3d(e.x, e.y, e.yaw);
      }
    }
    f.J.col(static_cast<Eigen::Index>(c)) = (side[0] - side[1]) / (2 * kStep);
  }
}

void DriveProblem::linearise(Factor& f) const {
  if (f.kind == Kind::kCamera) {
    linearise_camera(f);
  } else if (f.kind == Kind::kWheels) {
    linearise_wheels(f);
  } else {
    f.r = floor_off(state_.change);
    f.J.resize(3, 6);
    for (int c = 0; c < 6; ++c) {
      Parameters more = state_.change, less = state_.change;
      more[6 + c] += kStep, less[6 + c] -= kStep;
      f.J.col(c) = (floor_off(more) - floor_off(less)) / (2 * kStep);
    }
  }
  const double limit = f.kind == Kind::kCamera ? kHuberCamera : kHuberWheels;
  f.weight = f.out ? 0 : std::min(1.0, limit / std::max(f.r.norm(), 1e-12));
}

// ---- Solution

double DriveProblem::cost(const State& s) const {
  double sum = 0;
  for (const Factor& f : factors_) {
    if (f.out) continue;
    sum += huber(residual(f, s).norm(), f.kind == Kind::kCamera ? kHuberCamera : kHuberWheels);
  }
  for (std::size_t i = 0; i < kRobotParameters; ++i) {
    const double p = s.change[static_cast<Eigen::Index>(i)] / prior_of(i);
    sum += p * p;
  }
  return sum;
}

void DriveProblem::assemble(Eigen::MatrixXd& H, Eigen::VectorXd& g) {
  H.setZero(unknowns(), unknowns());
  g.setZero(unknowns());
  for (Factor& f : factors_) {
    linearise(f);
    if (f.out) continue;
    const Eigen::MatrixXd JtJ = f.weight * f.J.transpose() * f.J;
    const Eigen::VectorXd Jtr = f.weight * f.J.transpose() * f.r;
    for (std::size_t a = 0; a < f.index.size(); ++a) {
      g[f.index[a]] += Jtr[static_cast<Eigen::Index>(a)];
      for (std::size_t b = 0; b < f.index.size(); ++b) {
        H(f.index[a], f.index[b]) +=
            JtJ(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
      }
    }
  }
  for (int i = 0; i < static_cast<int>(kRobotParameters); ++i) {
    const double s = prior_of(static_cast<std::size_t>(i));
    H(i, i) += 1 / (s * s);
    g[i] += state_.change[i] / (s * s);
  }
}

DriveProblem::State DriveProblem::moved(const State& s, const Eigen::VectorXd& dx) const {
  State m = s;
  m.change += dx.head<12>();
  m.X_WP.translation() += dx.segment<3>(12);
  m.X_WP.linear() = turned(dx.segment<3>(15)) * s.X_WP.linear();
  m.X_WP = perception::orthonormalised(m.X_WP);
  for (std::size_t k = 1; k < m.X_PB.size(); ++k) {
    const Eigen::Vector3d d = dx.segment<3>(18 + 3 * (static_cast<Eigen::Index>(k) - 1));
    m.X_PB[k].x += d.x();
    m.X_PB[k].y += d.y();
    m.X_PB[k].yaw = perception::wrap_angle(m.X_PB[k].yaw + d.z());
  }
  return m;
}

bool DriveProblem::minimise() {
  constexpr int kMost = 60;
  double lambda = 1e-4, now = cost(state_), gain = 1;
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
  for (int i = 0; i < kMost; ++i) {
    assemble(H, g);
    bool better = false;
    for (int tries = 0; tries < 12 && !better; ++tries) {
      Eigen::MatrixXd damped = H;
      damped.diagonal() += lambda * H.diagonal();
      const Eigen::VectorXd dx = -damped.ldlt().solve(g);
      if (!dx.allFinite()) return false;
      // What no limit, no millimetre of any pose would notice.
      if (dx.cwiseAbs().maxCoeff() < 1e-9) return true;
      const State next = moved(state_, dx);
      const double then = cost(next);
      if (then < now) {
        better = true;
        state_ = next;
        if (now - then < 1e-9 * now + 1e-15) return true;
        gain = 1 - then / now;
        now = then;
        lambda = std::max(lambda * 0.1, 1e-12);
      } else {
        lambda = std::max(lambda * 10, 1e-9);
      }
    }
    if (!better) return true;  // no step leads down: it is the minimum to rounding
  }
  return gain < 1e-4;
}

// True: a factor changed sides.
bool DriveProblem::leave_out() {
  bool changed = false;
  for (Factor& f : factors_) {
    const bool out = f.kind != Kind::kFloor && residual(f, state_).norm() > kOut;
    changed = changed || out != f.out;
    f.out = out;
  }
  return changed;
}

int DriveProblem::left_out() const {
  int n = 0;
  for (const Factor& f : factors_) n += f.out ? 1 : 0;
  return n;
}

// Helmert: each kind's squares over its redundancy are the variance it should have had.
void DriveProblem::find_noise() {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
  assemble(H, g);
  const Eigen::MatrixXd C = H.ldlt().solve(Eigen::MatrixXd::Identity(H.rows(), H.cols()));
  covariance_ = 0.5 * (C.topLeftCorner<12, 12>() + C.topLeftCorner<12, 12>().transpose());
  double squares[3] = {0, 0, 0}, redundancy[3] = {0, 0, 0};  // place, turn, slip
  for (const Factor& f : factors_) {
    if (f.out || f.kind == Kind::kFloor) continue;
    const auto n = static_cast<Eigen::Index>(f.index.size());
    Eigen::MatrixXd part(n, n);
    for (Eigen::Index a = 0; a < n; ++a) {
      for (Eigen::Index b = 0; b < n; ++b)
        part(a, b) = C(f.index[static_cast<std::size_t>(a)], f.index[static_cast<std::size_t>(b)]);
    }
    const Eigen::VectorXd taken = (f.J * part * f.J.transpose()).diagonal();
    if (f.kind == Kind::kWheels) {
      const Pose2 d = driven(intervals_[static_cast<std::size_t>(f.of)], state_.change);
      if (std::hypot(d.x, d.y) < kMoved_m && std::abs(d.yaw) < kMoved_rad) continue;
    }
    for (Eigen::Index row = 0; row < f.r.size(); ++row) {
      const int kind = f.kind == Kind::kWheels ? 2 : row < 3 ? 0 : 1;
      squares[kind] += f.weight * f.r[row] * f.r[row];
      redundancy[kind] += 1 - f.weight * taken[row];
    }
  }
  double* const sigma[3] = {&noise_.camera_m, &noise_.camera_rad, &noise_.slip};
  const double least[3] = {kLeast.camera_m, kLeast.camera_rad, kLeast.slip};
  for (int kind = 0; kind < 3; ++kind) {
    if (redundancy[kind] < 3) continue;
    const double factor = std::clamp(squares[kind] / redundancy[kind], 0.01, 100.0);
    *sigma[kind] = std::max(least[kind], *sigma[kind] * std::sqrt(factor));
  }
}

bool DriveProblem::solve() {
  constexpr int kRounds = 12;
  whiten_wheels();
  for (int round = 0; round < kRounds; ++round) {
    if (!minimise()) return false;
    const bool changed = round > 0 && leave_out();
    const DriveNoise before = noise_;
    find_noise();
    whiten_wheels();
    const auto near = [](double a, double b) { return std::abs(a - b) < 0.02 * b; };
    if (round > 1 && !changed && near(before.camera_m, noise_.camera_m) &&
        near(before.camera_rad, noise_.camera_rad) && near(before.slip, noise_.slip))
      break;
  }
  if (!minimise()) return false;
  const DriveNoise found = noise_;
  find_noise();  // the covariance, at the solution
  noise_ = found;
  return true;
}

}  // namespace teletact

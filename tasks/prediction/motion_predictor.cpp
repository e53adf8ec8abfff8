#include "tasks/prediction/motion_predictor.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tasks {
namespace {

using Config = MotionPredictorConfig;

// chosen on: prediction 5, first halves of the logs; judged on: prediction 4, second halves
// (docs/measured/prediction.md)
constexpr double kJerk = 4.0, kTurnJerk = 20.0;  // density, (m/s^3)^2 s and (rad/s^3)^2 s
constexpr double kSingerJerk = 20.0, kSingerTurnJerk = 100.0;
constexpr double kNoise = 0.005, kTurnNoise = 0.02;  // of a measured velocity, m/s and rad/s
constexpr double kSlowJerk = 0.5, kSlowTurnJerk = 2.5, kMuchNoise = 0.03, kMuchTurnNoise = 0.12;
constexpr double kSlowTime_s = 0.05;
constexpr double kMemory_s = 2.0, kSharpness = 6.0;
constexpr double kKnowsAhead =
    0.5;  // share of its error that counts of a model that knows the commands
constexpr double kFloor = 0.003, kTurnFloor = 0.005;  // errors below it are alike, m/s and rad/s

constexpr double kSingerTime_s = 0.3;  // what `singer` means here

// How far a method's change of speed is believed: at this share of the limit of acceleration, and
// for so long. A fit or a filter takes one instant's noise for an acceleration.
// chosen on: mrclam6_robot3, trolley_mocap_mid; judged on: tuc_lecture_hall
constexpr MotionPredictor::Belief kOfAFit{0.4, 0.1}, kOfAFilter{0.5, 0.15};

std::unique_ptr<MotionModel> kalman() {
  return std::make_unique<AccelerationFilter>(
      AccelerationFilter::Config{0, {kJerk, kJerk, kTurnJerk}, {kNoise, kNoise, kTurnNoise}});
}

std::unique_ptr<MotionModel> singer() {
  return std::make_unique<AccelerationFilter>(AccelerationFilter::Config{
      kSingerTime_s, {kSingerJerk, kSingerJerk, kSingerTurnJerk}, {kNoise, kNoise, kTurnNoise}});
}

// For speeds with much noise: the velocity is a random walk (an acceleration that fades at once).
// Noise is averaged over about a third of a second, and nothing is extrapolated from it.
std::unique_ptr<MotionModel> smoothing() {
  return std::make_unique<AccelerationFilter>(
      AccelerationFilter::Config{kSlowTime_s,
                                 {kSlowJerk, kSlowJerk, kSlowTurnJerk},
                                 {kMuchNoise, kMuchNoise, kMuchTurnNoise}});
}

std::unique_ptr<MotionModel> linear(const Config& c, double ridge) {
  return std::make_unique<LinearModel>(
      LinearModel::Config{static_cast<std::size_t>(std::max(c.order, 1)),
                          static_cast<std::size_t>(std::max(c.training_samples, 1)), ridge});
}

Axes scales(const Config& c) {
  return {c.speed_scale_m_per_s, c.speed_scale_m_per_s, c.yaw_rate_scale_rad_per_s};
}
Axes limits(const Config& c) {
  return {c.acceleration_limit_m_per_s2, c.acceleration_limit_m_per_s2,
          c.yaw_acceleration_limit_rad_per_s2};
}

std::unique_ptr<MotionModel> learned(const Config& c) {
  return std::make_unique<LearnedShare>(LearnedShare::Config{
      c.window_s, c.spacing_s, c.lag_1_s, c.lag_2_s, c.prior_samples, scales(c), limits(c)});
}

std::unique_ptr<MotionModel> response(const Config& c) {
  return std::make_unique<CommandResponse>(CommandResponse::Config{
      c.response_time_s, c.window_s, c.prior_samples, c.spacing_s, scales(c)});
}

std::unique_ptr<Mixture> own(const Config& c) {
  std::vector<Mixture::Member> members;
  members.push_back({std::make_unique<ConstantVelocity>(), 1});
  members.push_back({kalman(), 2});
  members.push_back({singer(), 2});
  members.push_back({smoothing(), 4});
  members.push_back({learned(c), 2});
  members.push_back({response(c), 1, kKnowsAhead});
  return std::make_unique<Mixture>(
      Mixture::Config{kMemory_s, kSharpness, {kFloor, kFloor, kTurnFloor}, limits(c)},
      std::move(members));
}

}  // namespace

const std::vector<std::string>& MotionPredictorConfig::methods() {
  static const std::vector<std::string> names{
      "none", "constant_velocity", "hold", "paper", "ridge", "kalman", "singer", "lsq", "own"};
  return names;
}

void MotionPredictorConfig::describe(config::Section& s) {
  s.number("window_s", window_s, 0.5, 30, "length of the training data");
  s.number("spacing_s", spacing_s, 0.02, 1, "between training instants");
  s.number("lag_1_s", lag_1_s, 0.02, 1, "first velocity difference");
  s.number("lag_2_s", lag_2_s, 0.02, 2, "second velocity difference");
  s.text("method", method, methods(), "how the velocity goes on");
  s.number("prior_samples", prior_samples, 0.01, 1e6, "weight of the prior");
  s.number("speed_scale_m_per_s", speed_scale_m_per_s, 0.001, 10, "ordinary change of speed");
  s.number("yaw_rate_scale_rad_per_s", yaw_rate_scale_rad_per_s, 0.001, 10,
           "ordinary change of turn rate");
  s.integer("order", order, 1, 6, "paper, ridge: velocities that the next one is made from");
  s.integer("training_samples", training_samples, 1, 40, "paper, ridge: rows of the fit");
  s.number("acceleration_limit_m_per_s2", acceleration_limit_m_per_s2, 0.01, 100,
           "bound of the learned correction");
  s.number("yaw_acceleration_limit_rad_per_s2", yaw_acceleration_limit_rad_per_s2, 0.01, 100,
           "bound of the learned correction");
  s.number("response_time_s", response_time_s, 0.01, 5, "prior response to a command");
  s.number("ridge", ridge, 0, 1e6, "ridge: weight of small coefficients");
}

MotionPredictor::MotionPredictor(const MotionPredictorConfig& config)
    : acceleration_limit_(limits(config)) {
  const std::string& m = config.method;
  if (m == "none") {
    bounded_ = false;
    model_ = std::make_unique<StandStill>();
  } else if (m == "constant_velocity" || m == "hold") {
    model_ = std::make_unique<ConstantVelocity>();
  } else if (m == "paper") {
    model_ = linear(config, 0);
    belief_ = kOfAFit;
  } else if (m == "ridge") {
    model_ = linear(config, config.ridge);
    belief_ = kOfAFit;
  } else if (m == "kalman") {
    model_ = kalman();
    belief_ = kOfAFilter;
  } else if (m == "singer") {
    model_ = singer();
    belief_ = kOfAFilter;
  } else if (m == "lsq") {
    model_ = learned(config);
    commanded_ = response(config);
  } else if (m == "own") {
    auto mixture = own(config);
    mixture_ = mixture.get();
    model_ = std::move(mixture);
  } else {
    std::string all;
    for (const std::string& name : MotionPredictorConfig::methods())
      all += (all.empty() ? "" : ", ") + name;
    throw std::invalid_argument("prediction method \"" + m + "\" is not one of " + all);
  }
}

void MotionPredictor::clear() noexcept {
  history_.clear();
  model_->clear();
  if (commanded_) commanded_->clear();
  error_.clear();
}

bool MotionPredictor::add(const MotionSample& sample) noexcept {
  if (!history_.add(sample)) return false;
  model_->add(history_);
  if (commanded_) commanded_->add(history_);
  // Of a fast source only those are judged that stay in the history.
  if (size() >= 2 && sample.t - history_.sample(size() - 2).t < MotionHistory::kMinSpacing_s)
    return true;
  Prediction p;
  place(asked_h_, p);
  error_.add(history_, asked_h_, p.X_OB);
  return true;
}

bool MotionPredictor::add_command(double t, const perception::Twist2& cmd_B) noexcept {
  if (mixture_ != nullptr) mixture_->forget_answers();
  return history_.add_command(t, cmd_B);
}

void MotionPredictor::place(double h, Prediction& out) const noexcept {
  Motion motion;
  if (!(commanded_ && commanded_->predict(history_, h, motion)) &&
      !model_->predict(history_, h, motion)) {
    return;
  }
  if (bounded_) bound(h, motion);
  perception::Pose2 X = history_.newest().X_OB;
  const double part = h / static_cast<double>(Motion::kParts);
  for (const Axes& v : motion.part) X = perception::integrate(X, twist(v), part);
  out.X_OB = X;
  out.mean_B = twist(motion.mean());
  out.condition = motion.condition;
}

// Each part's mean velocity, by the part's middle. Where the commands are known, by the limit
// itself; else by as much of it as the method is believed.
void MotionPredictor::bound(double h, Motion& motion) const noexcept {
  const Axes now = axes(history_.newest().v_B);
  const double part = h / static_cast<double>(Motion::kParts);
  const bool told = history_.command_at(history_.newest().t) != nullptr;
  const double share = told ? 1 : belief_.share, changes_s = told ? h : belief_.changes_s;
  double t = 0.5 * part;
  for (Axes& mean : motion.part) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double reach = share * acceleration_limit_[k] * std::min(t, changes_s);
      const double v = std::isfinite(mean[k]) ? mean[k] : now[k];
      mean[k] = std::clamp(v, now[k] - reach, now[k] + reach);
    }
    t += part;
  }
}

bool MotionPredictor::peek(double t, Prediction& out) const noexcept {
  if (history_.size() == 0) return false;
  const double h = t - newest().t;
  out = {};
  out.X_OB = newest().X_OB;
  if (!(h > 0) || !std::isfinite(h)) return true;
  out.horizon = h;
  place(h, out);
  out.covariance = error_.covariance(h);
  return true;
}

bool MotionPredictor::predict(double t, Prediction& out) noexcept {
  if (!peek(t, out)) return false;
  if (out.horizon > 0) {
    asked_h_ = std::clamp(out.horizon, 0.01, 2.0);
    if (mixture_ != nullptr) mixture_->judge_at(asked_h_);
  }
  return true;
}

}  // namespace tasks

// `own`: what the other models say, weighted by how right each was of late.
//
// Each new sample asks every model for the horizon that was last asked for, and keeps what it said.
// When the samples reach that instant, the pose tells the true mean velocity, and each model's
// error of it (an axis at a time) goes into a fading mean. The weight of a model is that mean to
// the power -`sharpness`. So the mixture goes with the best model of the moment, is between models
// that are equally good, and can not be far worse than the best for longer than the memory. The
// correction of the last velocity is bounded by what the base's acceleration could do within the
// horizon. Source: Bates, Granger, The combination of forecasts, 1969; Cesa-Bianchi, Lugosi,
// Prediction, learning, and games, 2006.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

#include "tasks/prediction/motion_models.hpp"

namespace tasks {

class Mixture final : public MotionModel {
 public:
  struct Config {
    double memory_s = 2.0, sharpness = 4.0;
    Axes floor{}, acceleration_limit{};
  };
  // At most kMost models.
  static constexpr std::size_t kMost = 8;
  struct Member {
    std::unique_ptr<MotionModel> model;
    double prior_error =
        1;  // in units of the floor: what is taken for its error before anything is known
    // Its error counts by this share. Below 1: a model that knows of changes to come, which the
    // past can not tell of.
    double counts = 1;
  };
  Mixture(const Config&, std::vector<Member>);

  void add(const MotionHistory&) noexcept override;
  void clear() noexcept override;
  [[nodiscard]] bool predict(const MotionHistory&, double h, Motion& out) const noexcept override;
  // The horizon that the members are judged at from now on, 0.01 to 2 s.
  void judge_at(double h) noexcept;
  // What is known of the newest sample is no longer all: a command came.
  void forget_answers() noexcept { said_h_ = 0; }

 private:
  struct Pending {
    double t = 0, h = 0;
    perception::Pose2 X_OB;
    std::array<bool, kMost> known{};
    std::array<Axes, kMost> mean{};
  };
  static constexpr std::size_t kPending = 128;
  struct Said {
    bool known = false;
    Motion motion;
  };
  void settle(const MotionHistory&) noexcept;

  Config config_;
  std::vector<Member> members_;
  std::array<Axes, kMost> error_{};  // fading mean of |error|
  std::array<Pending, kPending> pending_{};
  std::size_t pending_head_ = 0, pending_size_ = 0;
  // What the members said of the newest sample for said_h_; 0: of none. Saves asking again where
  // the horizon stays.
  std::array<Said, kMost> said_{};
  double said_h_ = 0;
  double horizon_s_ = 0.15, settled_t_ = 0;
  bool settled_ = false;
};

}  // namespace tasks

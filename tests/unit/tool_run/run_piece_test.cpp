// A piece of a run: its figures are those of the piece, and what can not be cut is left out.
#include "tools/audit/run_piece.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "rt/audit/task_past.hpp"
#include "tasks/contract/table.hpp"

namespace {

using namespace teletact;

constexpr std::int64_t kEpoch = 5'000'000'000;
rt::Time at(double s) { return rt::Time{rt::Nanos{kEpoch + static_cast<std::int64_t>(1e9 * s)}}; }

bool has(const Metrics& m, const std::string& name) {
  return std::any_of(m.rows().begin(), m.rows().end(), [&](auto& r) { return r.name == name; });
}
double value(const Metrics& m, const std::string& name) {
  for (const auto& r : m.rows()) {
    if (r.name == name) return r.value;
  }
  ADD_FAILURE() << name << " is missing";
  return -1;
}

struct Halves {
  OperatorHalf op;
  RobotHalf robot;
};

// 20 s: 30 pictures a second of which fusion takes all, in contact from 10 s on, .5 m a second
// driven.
Halves halves_of_run() {
  Halves r;
  r.op.epoch_ns = r.robot.epoch_ns = kEpoch;
  rt::TaskLog fusion;
  fusion.id = static_cast<std::uint16_t>(tasks::TaskId::kFusion);
  fusion.spec.name = "fusion";
  fusion.spec.rate = {30, 1};
  for (int i = 0; i < 600; ++i) {
    const double t = i / 30.0;
    rt::JobRecord job;
    job.k = static_cast<std::uint64_t>(i);
    job.release_ns = job.start_ns = job.end_ns = rt::ns_of(at(t));
    job.deadline_ns = job.release_ns + 30'000'000;
    job.input_seq[0] = static_cast<std::uint64_t>(i) + 1;
    fusion.jobs.push_back(job);
    tasks::FusionSample f;
    f.stamp = at(t);
    f.consumed = f.tracked = true;
    r.op.view.fusion.push_back(f);
    tasks::LinkSample l;
    l.stamp = at(t);
    l.made = at(t - (t < 10 ? 0.5 : 0.05));
    l.picture = true;
    r.op.link.newest.push_back(l);
    tasks::HapticSample h;
    h.stamp = at(t);
    h.in_contact = t >= 10;
    h.force_N = t >= 15 ? 2.0F : 1.0F;
    r.op.view.haptic.push_back(h);
    r.robot.view.truth.push_back({at(t), 0, 0, 0, 0.5 * t, t >= 3 ? 1U : 0U});
  }
  r.op.log.tasks.push_back(fusion);
  r.op.view.task.marks = 7;
  r.op.view.engages = 3;
  return r;
}

Metrics figures(Halves r, const rt::StorePiece& piece) {
  std::erase_if(r.op.log.tasks[0].jobs, [&](const rt::JobRecord& j) {
    const double s = 1e-9 * static_cast<double>(j.release_ns - kEpoch);
    return s < piece.from_s || s >= piece.to_s;
  });
  RunInfo info;
  info.piece = true;
  const auto left_out = crop_to(piece, r.op, r.robot);
  Metrics all("report");
  add_metrics(info, r.op, r.robot, all);
  return without(all, "report", left_out);
}

TEST(RunPiece, FiguresAreThoseOfThePiece) {
  const Metrics m = figures(halves_of_run(), {5, 14});
  EXPECT_EQ(value(m, "fusion.frames"), 270);
  EXPECT_EQ(value(m, "fusion.frames_overwritten"), 0) << "frames before the piece are not lost";
  EXPECT_EQ(value(m, "fusion.frames_overwritten_share"), 0);
  EXPECT_NEAR(value(m, "link.pictures_per_s"), 30, 0.2);
  EXPECT_NEAR(value(m, "haptic.contact_share"), 4.0 / 9, 0.01);
  EXPECT_EQ(value(m, "haptic.force_max_N"), 1);
  EXPECT_NEAR(value(m, "robot.path_m"), 4.5, 0.05);
  EXPECT_EQ(value(m, "robot.collisions"), 0) << "it was before the piece";
  EXPECT_EQ(value(figures(halves_of_run(), {10, 12}), "link.picture_age_p95_ms"), 50);
}

TEST(RunPiece, FramesThatWereLostInItCount) {
  Halves r = halves_of_run();
  auto& jobs = r.op.log.tasks[0].jobs;
  std::erase_if(jobs, [](const rt::JobRecord& j) { return j.k >= 200 && j.k < 210; });
  EXPECT_EQ(value(figures(std::move(r), {5, 14}), "fusion.frames_overwritten"), 10);
}

TEST(RunPiece, WhatIsKnownOfTheWholeAloneIsLeftOut) {
  const Metrics m = figures(halves_of_run(), {5, 14});
  for (const char* name : {"mark.count", "operator.engages", "robot.held_s", "log.dropped",
                           "link.round_trip_ms", "plan.paths", "haptic.force_samples"})
    EXPECT_FALSE(has(m, name)) << name;
  // Samples from before the piece have gone: it may hold more than what is there.
  Halves r = halves_of_run();
  r.op.view.haptic_past.ticks = 1000;
  r.op.link.past.pictures = 100;
  r.op.view.haptic.erase(r.op.view.haptic.begin(), r.op.view.haptic.begin() + 300);
  r.op.link.newest.erase(r.op.link.newest.begin(), r.op.link.newest.begin() + 300);
  const Metrics old = figures(std::move(r), {5, 14});
  for (const char* name : {"haptic.contacts", "haptic.force_max_N", "link.pictures_per_s"})
    EXPECT_FALSE(has(old, name)) << name;
  EXPECT_TRUE(has(old, "fusion.frames"));
  Halves parts = halves_of_run();
  parts.op.log.tasks[0].past = std::make_shared<rt::TaskPast>();
  EXPECT_FALSE(has(figures(std::move(parts), {5, 14}), "fusion.frames_overwritten"));
}

}  // namespace

// A recorded run replays to the last bit whatever its timing was, in any order that its inputs
// allow; and a recording that was changed in one bit does not.
#include "tools/host/replay.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "config/fault_plan.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/run_options.hpp"
#include "tools/record/input_recorder.hpp"

namespace {

namespace fs = std::filesystem;
using teletact::JobOp;
using teletact::Recording;
using teletact::ReplayResult;

rt::NonRealtime& nrt() {
  static rt::Startup startup;
  return startup.token();
}

struct RecordedRun {
  std::string folder;  // of the recording
  teletact::VirtualRun run;
};

// Gone when the program ends.
class Folders {
 public:
  ~Folders() { fs::remove_all(root_); }
  std::string add(const std::string& name) {
    fs::create_directories(root_ / name);
    return (root_ / name).string();
  }

 private:
  fs::path root_ = fs::temp_directory_path() / ("teletact_replay_" + std::to_string(::getpid()));
};
Folders& folders() {
  static Folders f;
  return f;
}

RecordedRun record(const std::string& name, double seconds, const std::string& plan = {},
                   const std::string& scene_file = {},
                   const std::vector<std::string>& overrides = {}) {
  const auto scene = teletact::load_scene(
      scene_file.empty() ? teletact::find_config("scenes", "default_room") : scene_file, overrides);
  teletact::DemoOptions options;
  options.seconds = seconds;
  options.virtual_clock = options.quiet = options.record = true;
  options.cores = 2;
  options.report = folders().add(name);
  if (!plan.empty()) {
    options.fault_plan = options.report + "/plan.toml";
    std::ofstream(options.fault_plan) << plan;
  }
  RecordedRun r;
  r.run = teletact::run_virtual(nrt(), *scene, options, teletact::reference_calibration());
  r.folder = options.report + "/raw";
  return r;
}

const RecordedRun& plain() {
  static const RecordedRun r = record("plain", 6);
  return r;
}

rt::Result<ReplayResult> replay_file(const std::string& folder, const std::string& file,
                                     std::uint64_t order = 0) {
  rt::FaultPlan faults;
  if (fs::exists(folder + "/faults.toml"))
    faults = config::load_fault_plan(folder + "/faults.toml").value();
  auto recording = teletact::read_recording(file);
  if (!recording) return rt::Error{recording.error()};
  const auto scene = teletact::load_scene(folder + "/scene.toml", {});
  return teletact::replay(nrt(), *scene, faults, recording.value(), order);
}

void expect_equal(const RecordedRun& r, rt::Box box, std::uint64_t order = 0) {
  const auto result = replay_file(r.folder, teletact::recording_file(r.folder, box), order);
  ASSERT_TRUE(result) << result.error();
  const auto& v = result.value();
  EXPECT_EQ(v.equal, v.jobs) << "order " << order;
  EXPECT_EQ(v.first_difference, "") << "order " << order;
  // Every completed job of the run was in it.
  std::uint64_t completed = 0;
  const auto& log = box == rt::Box::kOperator ? r.run.op.log : r.run.robot.log;
  for (const auto& t : log.tasks) {
    for (const auto& j : t.jobs) completed += j.outcome == rt::Outcome::kCompleted ? 1 : 0;
  }
  EXPECT_EQ(v.jobs, completed);
  EXPECT_GT(v.jobs, 1000U);
}

// A copy of the plain operator recording that a test may change.
std::string copy_of_operator(const std::string& name) {
  const std::string to = folders().add("changed") + "/" + name;
  fs::copy_file(teletact::recording_file(plain().folder, rt::Box::kOperator), to,
                fs::copy_options::overwrite_existing);
  return to;
}

void flip_bit(const std::string& file, std::uint64_t byte, int bit) {
  std::fstream f(file, std::ios::in | std::ios::out | std::ios::binary);
  f.seekg(static_cast<std::streamoff>(byte));
  const int value = f.get();
  f.seekp(static_cast<std::streamoff>(byte));
  f.put(static_cast<char>(value ^ (1 << bit)));
}

TEST(Replay, EveryJobOfBothBoxesCommitsTheSame) {
  expect_equal(plain(), rt::Box::kOperator);
  expect_equal(plain(), rt::Box::kRobot);
}

// What is encoded hangs on what the link asked for: both boxes come out the same from what was
// recorded of it, on a road too slow for every frame, and with demands that are lost.
TEST(Replay, FramesCodedOnDemandAreReplayedToo) {
  const auto r = record("demand", 6,
                        "name = \"lost\"\npurpose = \"lost demands\"\nseed = 3\n[[fault]]\nkind = "
                        "\"drop\"\ntarget = \"demand\"\nprobability = 0.2\n",
                        {},
                        {"link.depth_codec=\"quiet\"", "link.shape.delay_ms=60",
                         "link.shape.jitter_ms=5", "link.shape.rate_Mbit_per_s=40"});
  expect_equal(r, rt::Box::kRobot);
  expect_equal(r, rt::Box::kOperator);
  expect_equal(r, rt::Box::kRobot, 11);
  // Without the demands there is nothing to encode: one that was changed shows.
  auto recording = teletact::read_recording(teletact::recording_file(r.folder, rt::Box::kRobot));
  ASSERT_TRUE(recording) << recording.error();
  std::uint64_t asked = 0, answered_late = 0;
  for (const auto& op : recording.value().ops) {
    if (op.task != static_cast<std::uint16_t>(tasks::TaskId::kCapture) ||
        op.kind != JobOp::Kind::kLatch)
      continue;
    const auto in = op.get<teletact::CameraInput>();
    answered_late += in.seq == asked ? 1 : 0;
    asked = std::max(asked, in.seq);
  }
  EXPECT_GT(asked, 60U);
  EXPECT_GT(answered_late, 5U) << "a demand was lost or the line was busy";
}

// A stall, a flap with another connection behind it, damaged bytes: each message as it came, each
// job as it was.
TEST(Replay, ABadRoadIsReplayedToo) {
  const auto r =
      record("road", 6, {}, {},
             {"link.shape.delay_ms=0", "link.shape.jitter_ms=0", "link.shape.rate_Mbit_per_s=0",
              "link.network.delay_ms=30", "link.network.jitter_ms=5",
              "link.network.rate_Mbit_per_s=60", "link.network.stall=[{at_s=1, for_ms=400}]",
              "link.network.flaps_per_minute=20", "link.network.flap_from_s=2",
              "link.network.corrupt_per_MB=1", "link.network.corrupt_from_s=4"});
  expect_equal(r, rt::Box::kOperator);
  expect_equal(r, rt::Box::kRobot);
}

// Joint angles travel with the images: through the link, into both recordings, and back.
TEST(Replay, AnArmBeforeTheCameraIsReplayedToo) {
  const auto r = record("arm", 5, {}, teletact::find_config("scenes", "arm"));
  expect_equal(r, rt::Box::kOperator);
  expect_equal(r, rt::Box::kRobot);
  // Joints that are not those of the image: another mask, another map.
  auto recording = teletact::read_recording(teletact::recording_file(r.folder, rt::Box::kRobot));
  ASSERT_TRUE(recording) << recording.error();
  ASSERT_GT(recording.value().frames.size(), 100U);
  const std::string changed = folders().add("changed") + "/arm.inputs";
  fs::copy_file(recording.value().path, changed, fs::copy_options::overwrite_existing);
  flip_bit(changed,
           recording.value().frames[90] + offsetof(teletact::FrameHead, joints) +
               offsetof(perception::JointAngles, position) + 2,
           5);
  const auto other = replay_file(r.folder, changed);
  ASSERT_TRUE(other) << other.error();
  EXPECT_LT(other.value().equal, other.value().jobs);
}

// The order rules are complete: no allowed order gives anything else.
TEST(Replay, AnyOrderThatTheInputsAllowGivesTheSame) {
  for (const std::uint64_t order : {1U, 2U}) {
    expect_equal(plain(), rt::Box::kOperator, order);
  }
  expect_equal(plain(), rt::Box::kRobot, 3);
}

TEST(Replay, OrdersReallyDiffer) {
  const auto r =
      teletact::read_recording(teletact::recording_file(plain().folder, rt::Box::kOperator));
  ASSERT_TRUE(r) << r.error();
  const auto a = teletact::replay_order(r.value()), b = teletact::replay_order(r.value(), 1);
  ASSERT_TRUE(a && b);
  ASSERT_EQ(a.value().size(), b.value().size());
  std::size_t moved = 0;
  for (std::size_t i = 0; i < a.value().size(); ++i) {
    moved +=
        a.value()[i].message != b.value()[i].message || a.value()[i].index != b.value()[i].index;
  }
  EXPECT_GT(moved, a.value().size() / 2);
}

TEST(Replay, RecordingChangesNothing) {
  const auto scene = teletact::load_scene(teletact::find_config("scenes", "default_room"), {});
  teletact::DemoOptions options;
  options.seconds = 6;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  const auto bare =
      teletact::run_virtual(nrt(), *scene, options, teletact::reference_calibration());
  EXPECT_EQ(bare.sched_hash, plain().run.sched_hash);
  EXPECT_EQ(bare.log_hash, plain().run.log_hash);
}

// The hand marks the pedestal instead of the floor: it becomes an object, fusion publishes it and
// planning reads it.
TEST(Replay, ObjectsReplayToo) {
  std::ifstream in(teletact::find_config("scenes", "default_room"));
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const auto first = text.find("[[hand.segment]]"), rest = text.find("[fusion]");
  ASSERT_TRUE(first != std::string::npos && rest != std::string::npos && first < rest);
  const char* at = "point_m = [1.403, -0.676, 0.30]\nnormal = [-0.2588, 0.9659, 0.0]\n";
  std::string hand;
  for (const std::string& segment :
       {std::string("kind = \"move\"\nstandoff_m = 0.06\ntime_s = 0.8\n") + at,
        std::string("kind = \"press\"\ndepth_m = 0.09\ntime_s = 0.5\n") + at,
        std::string("kind = \"button_down\"\nsource = \"last\"\ntime_s = 0.3\n"),
        std::string("kind = \"button_up\"\nsource = \"last\"\ntime_s = 0.3\n")})
    hand += "[[hand.segment]]\n" + segment + "\n";
  text = text.substr(0, first) + hand + text.substr(rest) +
         "\n[fusion.tsdf]\nvoxel_size_m = 0.02\n[fusion.objects]\nenabled = true\n";
  const std::string file = folders().add("scenes") + "/objects.toml";
  std::ofstream(file) << text;
  const auto r = record("objects", 5, {}, file);
  EXPECT_EQ(r.run.op.view.objects_named, 1U);
  const auto& list = r.run.op.view.objects;
  EXPECT_GT(list.seq, 30U);
  EXPECT_GT(list.mark_seq, 0U);
  EXPECT_EQ(list.answer, perception::TouchAnswer::kObject) << perception::text_of(list.answer);
  expect_equal(r, rt::Box::kOperator);
}

// The published method reads fusion's ray cast: which one a tick used is part of the recording.
TEST(Replay, ThePublishedMethodReplaysToo) {
  const auto r = record("force_shading", 6, {}, {}, {"haptic.method=\"force_shading\""});
  expect_equal(r, rt::Box::kOperator);
  expect_equal(r, rt::Box::kOperator, 5);
  auto recording = teletact::read_recording(teletact::recording_file(r.folder, rt::Box::kOperator));
  ASSERT_TRUE(recording) << recording.error();
  std::uint64_t newest = 0, last = 0;
  for (const JobOp& op : recording.value().ops) {
    if (op.task == static_cast<std::uint16_t>(tasks::TaskId::kHaptic) &&
        op.kind == JobOp::Kind::kLatch)
      newest = op.seq[4];
    if (op.task == static_cast<std::uint16_t>(tasks::TaskId::kFusion) &&
        op.kind == JobOp::Kind::kCommit)
      last = op.get<teletact::Ended>().published[5];
  }
  EXPECT_GE(last, 13U);
  EXPECT_GE(newest + 1, last);
  // A tick that would have read another one is told of.
  for (JobOp& op : recording.value().ops) {
    if (op.task != static_cast<std::uint16_t>(tasks::TaskId::kHaptic) || op.seq[4] != 8) continue;
    op.seq[4] = 7;
  }
  const auto scene = teletact::load_scene(r.folder + "/scene.toml", {});
  const auto other = teletact::replay(nrt(), *scene, {}, recording.value(), 0);
  EXPECT_TRUE(!other || other.value().equal < other.value().jobs ||
              !other.value().first_difference.empty());
  // Without the method nobody reads or makes one.
  const auto bare =
      teletact::read_recording(teletact::recording_file(plain().folder, rt::Box::kOperator));
  ASSERT_TRUE(bare) << bare.error();
  for (const JobOp& op : bare.value().ops) {
    const bool latch = op.kind == JobOp::Kind::kLatch, commit = op.kind == JobOp::Kind::kCommit;
    const auto task = static_cast<tasks::TaskId>(op.task);
    ASSERT_FALSE(task == tasks::TaskId::kHaptic && latch && op.seq[4] != 0);
    ASSERT_FALSE(task == tasks::TaskId::kFusion && commit &&
                 op.get<teletact::Ended>().published[5] != 0);
  }
}

// What the operator asked of the scene, and what the console said that it had taken of the mesh,
// are inputs.
TEST(Replay, EditsAndTheMeshReplayToo) {
  std::ifstream in(teletact::find_config("scenes", "default_room"));
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const auto fusion = text.find("[fusion]\n");
  ASSERT_NE(fusion, std::string::npos);
  text.insert(fusion + 9, "mesh_blocks = 60\n");
  text += R"(
[[operator.edit]]
kind = "clear"
at_s = 1.2
position_m = [1.0, 0.05, 0.1]
size_m = [0.4, 0.6, 0.3]
[[operator.edit]]
kind = "box"
at_s = 1.5
position_m = [2.2, 0.5, 0]
size_m = [0.3, 0.2, 0.1]
yaw_deg = 20
id = 3
[[operator.edit]]
kind = "clear"
at_s = 1.5
source = "pixel"
pixel = [256, 300]
[[operator.edit]]
kind = "erase"
at_s = 2.4
id = 3
)";
  const std::string file = folders().add("scenes") + "/edits.toml";
  std::ofstream(file) << text;
  const auto r = record("edits", 3, {}, file);
  EXPECT_EQ(r.run.op.view.edits, 4U);
  expect_equal(r, rt::Box::kOperator);
  expect_equal(r, rt::Box::kOperator, 4);
}

// Late, overrunning, blocked and aborted jobs, stolen cores, lost and repeated messages.
TEST(Replay, TimingFaultsReplayToo) {
  const RecordedRun r = record("faults", 6, R"(
name = "timing"
seed = 5
[[fault]]
kind = "late_release"
target = "haptic"
first = 100
every = 7
probability = 0.5
magnitude_us = 950
[[fault]]
kind = "extra_cpu"
target = "haptic"
first = 300
every = 61
magnitude_us = 2300
[[fault]]
kind = "theft"
target = "fusion"
first = 20
every = 11
magnitude_us = 17000
[[fault]]
kind = "late_release"
target = "fusion"
first = 15
every = 9
magnitude_us = 12000
[[fault]]
kind = "extra_cpu"
target = "planning"
first = 5
every = 3
magnitude_us = 120000
[[fault]]
kind = "block"
target = "supervision"
first = 40
every = 23
magnitude_us = 4000
[[fault]]
kind = "extra_cpu"
target = "robot_io"
first = 200
every = 83
magnitude_us = 3100
[[fault]]
kind = "drop"
target = "patch"
first = 10
every = 6
[[fault]]
kind = "drop"
target = "robot_state"
first = 50
probability = 0.2
)");
  EXPECT_NE(r.run.sched_hash, plain().run.sched_hash);
  std::uint64_t aborted = 0, skipped = 0;
  for (const auto& t : r.run.op.totals) {
    aborted += t.totals.aborted;
    skipped += t.totals.skipped;
  }
  EXPECT_GE(aborted, 10U);
  EXPECT_GE(skipped, 50U);
  expect_equal(r, rt::Box::kOperator);
  expect_equal(r, rt::Box::kOperator, 7);
  expect_equal(r, rt::Box::kRobot);
}

// The k-th latch of a task in the file: where its op begins.
std::uint64_t op_offset(const std::string& file, tasks::TaskId task, std::uint64_t k) {
  std::ifstream in(file, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  std::size_t at = bytes.find("\n\n") + 2;
  while (at < bytes.size()) {
    const char tag = bytes[at++];
    if (tag == 'O') {
      JobOp op;
      std::memcpy(&op, bytes.data() + at, sizeof op);
      if (op.task == static_cast<std::uint16_t>(task) && op.k == k &&
          op.kind == JobOp::Kind::kLatch) {
        return at;
      }
      at += sizeof op;
    } else if (tag == 'M') {
      teletact::MessageHead head;
      std::memcpy(&head, bytes.data() + at, sizeof head);
      at += sizeof head + head.size;
    } else {
      break;
    }
  }
  ADD_FAILURE() << "no such job";
  return 0;
}

TEST(Replay, OneBitOfOneStylusSampleShows) {
  const std::string file = copy_of_operator("stylus");
  const std::uint64_t at = op_offset(file, tasks::TaskId::kHaptic, 3000);
  JobOp op;
  {
    std::ifstream in(file, std::ios::binary);
    in.seekg(static_cast<std::streamoff>(at));
    in.read(reinterpret_cast<char*>(&op), sizeof op);
  }
  auto sample = op.get<teletact::StylusInput>();
  auto bits = std::bit_cast<std::uint64_t>(sample.p_DH[0]);
  sample.p_DH[0] = std::bit_cast<double>(bits ^ (1ULL << 30U));  // far below a nanometre
  op.put(sample);
  {
    std::fstream out(file, std::ios::in | std::ios::out | std::ios::binary);
    out.seekp(static_cast<std::streamoff>(at));
    out.write(reinterpret_cast<const char*>(&op), sizeof op);
  }
  const auto result = replay_file(plain().folder, file);
  ASSERT_TRUE(result) << result.error();
  EXPECT_FALSE(result.value().same());
  EXPECT_LT(result.value().equal, result.value().jobs);
  EXPECT_NE(result.value().first_difference.find("haptic job 3000: output"), std::string::npos)
      << result.value().first_difference;
}

TEST(Replay, OneBitOfOneFrameShows) {
  const std::string file = copy_of_operator("frame");
  const auto r = teletact::read_recording(file);
  ASSERT_TRUE(r) << r.error();
  std::uint32_t index = 0, found = 0;
  for (std::uint32_t i = 0; i < r.value().messages.size(); ++i) {
    if (r.value().messages[i].head.size > 10000 && ++found == 60) index = i;
  }
  ASSERT_GT(index, 0U);
  const auto& m = r.value().messages[index];
  flip_bit(file, m.offset + m.head.size / 2, 3);
  const auto result = replay_file(plain().folder, file);
  ASSERT_TRUE(result) << result.error();
  EXPECT_FALSE(result.value().same());
  EXPECT_NE(result.value().first_difference.find("message " + std::to_string(index)),
            std::string::npos)
      << result.value().first_difference;
  EXPECT_LT(result.value().equal, result.value().jobs) << "fusion went on with another frame";
}

TEST(Replay, AnotherSceneShows) {
  const auto r =
      teletact::read_recording(teletact::recording_file(plain().folder, rt::Box::kOperator));
  ASSERT_TRUE(r) << r.error();
  const auto scene = teletact::load_scene(plain().folder + "/scene.toml",
                                          {"haptic.stiffness_N_per_m=1000.0000001"});
  const auto result = teletact::replay(nrt(), *scene, {}, r.value());
  ASSERT_TRUE(result) << result.error();
  EXPECT_FALSE(result.value().same());
  EXPECT_NE(result.value().first_difference.find("haptic job"), std::string::npos);
}

TEST(Replay, ATornRecordingIsRefusedWithOneMessage) {
  const std::string file = copy_of_operator("torn");
  const auto size = fs::file_size(file);
  for (const std::uintmax_t keep :
       {size - 1, size - sizeof(teletact::Tally) - 1, size / 2, size / 7}) {
    fs::resize_file(file, keep);
    const auto result = replay_file(plain().folder, file);
    ASSERT_FALSE(result) << keep;
    EXPECT_NE(result.error().find(file), std::string::npos) << result.error();
    EXPECT_NE(result.error().find("cut off"), std::string::npos) << result.error();
    EXPECT_EQ(result.error().find('\n'), std::string::npos);
  }
  fs::resize_file(file, 10);
  EXPECT_FALSE(teletact::read_recording(file));
  EXPECT_FALSE(teletact::read_recording(file + ".absent"));
}

TEST(Replay, ARecordingThatLostInputsIsRefused) {
  const std::string file = copy_of_operator("lost");
  const auto size = fs::file_size(file);
  flip_bit(file, size - sizeof(std::uint64_t), 0);  // Tally::lost = 1
  const auto result = replay_file(plain().folder, file);
  ASSERT_FALSE(result);
  EXPECT_NE(result.error().find("1 inputs were lost"), std::string::npos) << result.error();
}

// A job that used what was published only after it, or never.
TEST(Replay, InputsThatContradictEachOtherAreRefused) {
  auto r = teletact::read_recording(teletact::recording_file(plain().folder, rt::Box::kOperator));
  ASSERT_TRUE(r) << r.error();
  Recording never = r.value();
  Recording cycle = r.value();
  for (Recording* x : {&never, &cycle}) {
    std::uint64_t haptic_mode = 0;
    for (auto& op : x->ops) {
      if (op.kind != JobOp::Kind::kLatch) continue;
      if (op.task == static_cast<std::uint16_t>(tasks::TaskId::kHaptic)) haptic_mode = op.seq[1];
      if (op.task == static_cast<std::uint16_t>(tasks::TaskId::kFusion) && op.k == 30) {
        op.seq[1] = x == &never ? 1000000 : op.seq[1] + 500;  // the hand, half a second ahead
      }
    }
    EXPECT_GT(haptic_mode, 0U);
  }
  const auto a = teletact::replay_order(never), b = teletact::replay_order(cycle);
  ASSERT_FALSE(a);
  EXPECT_NE(a.error().find("never published"), std::string::npos) << a.error();
  ASSERT_FALSE(b);
  EXPECT_NE(b.error().find("contradict"), std::string::npos) << b.error();
}

// ---- trials: other variants on the same input

rt::Result<ReplayResult> trial(rt::Box box, int task, int level, std::vector<rt::JobRecord>& jobs,
                               const std::string& file = {}) {
  const auto& r = plain();
  auto recording =
      teletact::read_recording(file.empty() ? teletact::recording_file(r.folder, box) : file);
  if (!recording) return rt::Error{recording.error()};
  const auto scene = teletact::load_scene(r.folder + "/scene.toml", {});
  teletact::Trial t;
  t.level = [&](tasks::TaskId id, int recorded) {
    return static_cast<int>(id) == task ? level : recorded;
  };
  t.took = [&](const rt::JobRecord& j) { jobs.push_back(j); };
  return teletact::run_trial(nrt(), *scene, recording.value(), t);
}

TEST(Trial, EveryVariantIsFedTheSameBytes) {
  for (const auto box : {rt::Box::kOperator, rt::Box::kRobot}) {
    const auto whole = replay_file(plain().folder, teletact::recording_file(plain().folder, box));
    ASSERT_TRUE(whole) << whole.error();
    const auto task = box == rt::Box::kOperator ? tasks::TaskId::kFusion : tasks::TaskId::kCapture;
    std::vector<std::uint64_t> work;
    for (int level = 0; level < 2; ++level) {
      std::vector<rt::JobRecord> jobs;
      const auto t = trial(box, static_cast<int>(task), level, jobs);
      ASSERT_TRUE(t) << t.error();
      EXPECT_EQ(t.value().inputs_hash, whole.value().inputs_hash) << level;
      EXPECT_EQ(t.value().first_difference, "") << level;
      EXPECT_EQ(t.value().jobs, whole.value().jobs);
      ASSERT_EQ(jobs.size(), whole.value().jobs);
      std::uint64_t sum = 0;
      for (const auto& j : jobs) {
        EXPECT_GT(j.cpu_ns, 0);
        if (j.task != static_cast<std::uint16_t>(task)) continue;
        EXPECT_EQ(j.level, level);
        sum += j.work;
      }
      work.push_back(sum);
    }
    EXPECT_GT(work[0], work[1]) << "the level changes what is done";
  }
}

TEST(Trial, OtherBytesAreAnotherHash) {
  const std::string file = copy_of_operator("trial.inputs");
  const auto recording = teletact::read_recording(file);
  ASSERT_TRUE(recording);
  // One bit in the middle of a message.
  const auto& m = recording.value().messages[recording.value().messages.size() / 2];
  {
    std::fstream f(file, std::ios::in | std::ios::out | std::ios::binary);
    f.seekg(static_cast<std::streamoff>(m.offset + m.head.size / 2));
    const char c = static_cast<char>(f.get());
    f.seekp(static_cast<std::streamoff>(m.offset + m.head.size / 2));
    f.put(static_cast<char>(c ^ 1));
  }
  std::vector<rt::JobRecord> jobs;
  const auto good = trial(rt::Box::kOperator, -1, 0, jobs);
  const auto bad = trial(rt::Box::kOperator, -1, 0, jobs, file);
  ASSERT_TRUE(good) << good.error();
  ASSERT_TRUE(bad) << bad.error();
  EXPECT_NE(good.value().inputs_hash, bad.value().inputs_hash);
  EXPECT_NE(bad.value().first_difference, "") << "the endpoint refuses a message with a wrong sum";
}

}  // namespace

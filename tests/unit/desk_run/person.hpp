// A person in place of the page, who sits at the desk of a run on the virtual clock; and what the
// tests of such runs share.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "tools/desk/desk.hpp"
#include "tools/host/calibrate.hpp"
#include "tools/host/replay.hpp"
#include "tools/host/run_options.hpp"
#include "tools/record/input_recorder.hpp"
#include "tools/scene/page_hook.hpp"

namespace desk_run {

namespace fs = std::filesystem;
using nlohmann::json;
using teletact::ConsoleAnswer;
using teletact::DemoOptions;
using teletact::Desk;
using teletact::Scene;
using teletact::VirtualRun;

inline rt::Startup& startup() {
  static rt::Startup s;
  return s;
}

inline const fs::path& folder() {
  static const struct Folder {
    fs::path path = fs::temp_directory_path() / ("teletact_desk_" + std::to_string(::getpid()));
    Folder() { fs::create_directories(path); }
    ~Folder() { fs::remove_all(path); }
  } f;
  return f.path;
}

// The desk without a server. Each tick asks `person` what to do; instants are seconds of the run.
class Person : public teletact::PageHook {
 public:
  drivers::HapticDevice* hand_over(rt::NonRealtime& nrt, drivers::HapticDevice& device) override {
    hand = std::make_unique<teletact::PageHand>(nrt, device);
    return hand.get();
  }
  void open(teletact::OperatorBox& box, teletact::OperatorConsole& console, const Scene& scene,
            rt::Time epoch, Clock) override {
    epoch_ = epoch;
    console_ = &console;
    teletact::DeskOptions o;
    o.clock = [this] { return late_ns == 0 ? now_ns_ : clock_ns_ += late_ns; };
    o.paced = paced;
    o.log = log;
    o.hand = hand.get();
    o.tasks = &watch;
    o.clicks_at_once = true;
    o.sessions = sessions;
    hand->bind(box.graph().haptic());
    teletact::DeskPort port;
    port.viewers = [this] { return viewers; };
    port.publish = [this](teletact::ViewKind kind, const teletact::ViewStamp& at,
                          std::span<const std::uint8_t> body) {
      ++views[kind];
      bytes[kind] = body.size();
      if (kind == teletact::ViewKind::kPicture) picture.assign(body.begin(), body.end());
      if (kind == teletact::ViewKind::kText) {
        text.assign(body.begin(), body.end());
        text_at_ns = tasks_at_ns = rt::ns_of(epoch_) + std::llround(1e9 * at.time_s);
      }
      return true;
    };
    port.wants_whole_mesh = [this] { return whole_mesh; };
    port.mesh = [this](const perception::MeshDelta& d, const teletact::ViewStamp&, double) {
      if (d.restart) whole_mesh = false;
      mesh_blocks += d.block_count;
      return true;
    };
    port.view_to = [this](std::uint32_t, teletact::ViewKind kind, const teletact::ViewStamp&,
                          std::span<const std::uint8_t> body) {
      ++views[kind];
      selection.assign(body.begin(), body.end());
      return true;
    };
    port.answer = [this](std::uint32_t, std::int64_t id, const ConsoleAnswer& a) {
      answers[id] = a;
    };
    desk = std::make_unique<Desk>(box, console, scene, epoch, o, port);
  }
  void tick(rt::Time now) override {
    now_ns_ = rt::ns_of(now);
    const double t = rt::seconds(now - epoch_);
    if (act) act(t);
    if (!holds.is_null() && now_ns_ >= next_token_ns_) {
      next_token_ns_ = now_ns_ + 50'000'000;
      say({{"act", "token"}, {"holds", holds}});
      if (driven) say(*driven);
    }
    desk->tick(now);
  }
  void tasks(const rt::RunLog& header) override { watch.tasks(header); }
  void job(const rt::JobRecord& record) override { watch.add(record); }
  void close() override {}
  std::int64_t cpu_ns() const override { return 0; }

  // The number of the act.
  std::int64_t say(json intent) {
    intent["id"] = ++id_;
    if (auto a = desk->take(1, id_, intent["act"].get<std::string>(), intent)) answers[id_] = *a;
    return id_;
  }
  // At t, once.
  bool once(const std::string& what, double t, double at) {
    return t >= at && done_.insert(what).second;
  }
  const teletact::OperatorView& seen() const { return console_->seen(); }
  std::string status_line() const { return console_->status_line(now()); }
  rt::Time now() const { return rt::time_from_ns(now_ns_); }

  std::function<void(double)> act;
  json holds;                  // null: no token is sent
  std::optional<json> driven;  // with each token
  std::map<std::int64_t, ConsoleAnswer> answers;
  std::map<teletact::ViewKind, int> views;
  std::map<teletact::ViewKind, std::size_t> bytes;
  std::vector<std::uint8_t> picture, selection;  // bodies of the newest views
  std::string text;
  std::int64_t text_at_ns = 0;   // operator's clock
  std::int64_t tasks_at_ns = 0;  // the last look at the tasks' timing before it
  teletact::TaskWatch watch;
  teletact::SessionPlace sessions;  // no folder: none are kept
  // Of the clock of arrivals: each look at it is so much later than the one before. 0: it is the
  // run's.
  std::int64_t late_ns = 0;
  bool paced = false;
  std::string log;  // file of events; empty: none
  int viewers = 0, mesh_blocks = 0;
  bool whole_mesh = true;
  std::unique_ptr<Desk> desk;
  std::unique_ptr<teletact::PageHand> hand;

 private:
  rt::Time epoch_{};
  teletact::OperatorConsole* console_ = nullptr;
  std::int64_t now_ns_ = 0, clock_ns_ = 0, next_token_ns_ = 0, id_ = 0;
  std::set<std::string> done_;
};

inline std::unique_ptr<Scene> scene(const std::vector<std::string>& overrides = {}) {
  auto s = teletact::load_scene(teletact::find_config("scenes", "default_room"), overrides);
  s->hand.start_after_s = 3600;  // nobody moves the hand
  return s;
}

inline VirtualRun run(Scene& s, double seconds, Person& person, DemoOptions options = {}) {
  options.seconds = seconds;
  options.virtual_clock = options.quiet = true;
  options.cores = 2;
  options.page = &person;
  return teletact::run_virtual(startup().token(), s, options, teletact::reference_calibration());
}

inline bool same_again(const std::string& folder, rt::Box box) {
  auto recording = teletact::read_recording(teletact::recording_file(folder, box));
  EXPECT_TRUE(recording) << recording.error();
  if (!recording) return false;
  const auto s = teletact::load_scene(folder + "/scene.toml", {});
  const auto result = teletact::replay(startup().token(), *s, {}, recording.value());
  EXPECT_TRUE(result) << result.error();
  if (!result) return false;
  EXPECT_TRUE(result.value().same()) << result.value().first_difference;
  EXPECT_GT(result.value().jobs, 1000U);
  return result.value().same();
}

}  // namespace desk_run

#include "tools/record/box_recorder.hpp"

#include <signal.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>

#include "tasks/supervision/fault_ids.hpp"

namespace teletact {

namespace {

std::atomic<rt::BlackBoxWriter*> g_crash_box{nullptr};
constexpr int kCrashes[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

// Only what is allowed in a handler: bytes into a mapping that stands.
void on_crash(int number) {
  char text[] = "crash, signal 00";
  text[sizeof text - 3] = static_cast<char>('0' + number / 10 % 10);
  text[sizeof text - 2] = static_cast<char>('0' + number % 10);
  if (auto* box = g_crash_box.load()) box->note_stop({text, sizeof text - 1});
  // The action is back at its default (SA_RESETHAND). A fault would come again by itself, a signal
  // that somebody sent would not.
  ::raise(number);
}

// Inputs of every job and some lines and marks a second, in the ring.
double more_per_s(const rt::RunLog& header) {
  double per_s = 20000;
  for (const auto& t : header.tasks) {
    per_s += static_cast<double>(t.spec.rate.num) / static_cast<double>(t.spec.rate.den) *
             static_cast<double>(rt::BlackBoxWriter::stored(sizeof(JobOp)));
  }
  return per_s;
}

std::string stem_of(const std::string& folder, rt::Box box) {
  return folder + (box == rt::Box::kOperator ? "/operator" : "/robot");
}

template <class T>
std::span<const std::byte> raw(const T& v) noexcept {
  static_assert(std::is_trivially_copyable_v<T>);
  return std::as_bytes(std::span(&v, 1));
}

bool is_stop(tasks::Mode m) { return m == tasks::Mode::kRampDown || m == tasks::Mode::kSafeStop; }

}  // namespace

BoxRecorder::BoxRecorder(const std::string& folder, rt::Box box, const rt::RunLog& header,
                         double seconds)
    : stem_(stem_of(folder, box)),
      writer_(stem_ + ".blackbox", header, rt::nanos_from_seconds(seconds),
              rt::black_box_size(header, rt::nanos_from_seconds(seconds), more_per_s(header))) {}

BoxRecorder::~BoxRecorder() {
  if (std::uncaught_exceptions() > 0) writer_.note_stop("an error ended the process");
  rt::BlackBoxWriter* mine = &writer_;
  g_crash_box.compare_exchange_strong(mine, nullptr);
}

void BoxRecorder::add(const JobOp& op) noexcept { writer_.add('I', raw(op)); }
void BoxRecorder::add(const RecordingMark& mark) noexcept { writer_.add('R', raw(mark)); }
void BoxRecorder::line(std::string_view text) noexcept {
  writer_.add('L', std::as_bytes(std::span(text.data(), text.size())));
}

void BoxRecorder::catch_crashes() noexcept {
  g_crash_box.store(&writer_);
  struct sigaction action {};
  action.sa_handler = on_crash;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_NODEFER);
  for (const int number : kCrashes) sigaction(number, &action, nullptr);
}

void BoxRecorder::watch(const tasks::ModeMsg& mode, rt::Time now) {
  const bool safe = mode.mode == tasks::Mode::kSafeStop;
  if (is_stop(mode.mode) && mode.mode != mode_) {
    const std::string why = std::string(safe ? "safe stop: " : "ramp down: ") +
                            fault_text(mode.cause) + fault_advice(mode.cause);
    if (pending_.empty()) {
      pending_ = why;
      due_ = now + kAfterStop;
    } else if (safe) {
      pending_ += "; then " + why;
    }
    pending_safe_ = pending_safe_ || safe;
  }
  mode_ = mode.mode;
  if (!pending_.empty() && now >= due_) copy_stop();
}

std::string BoxRecorder::copy_of(int stop) const {
  return stem_ + ".stop" + std::to_string(stop) + ".blackbox";
}

void BoxRecorder::copy_stop() {
  const std::string path = copy_of(++stops_);
  kept_.push_back({stops_, pending_safe_});
  if (!writer_.copy_to(path, pending_))
    std::fprintf(stderr, "teletact: %s: can not be written\n", path.c_str());
  pending_.clear();
  pending_safe_ = false;
  if (kept_.size() <= kMaxStops) return;
  auto goes = std::find_if(kept_.begin(), kept_.end(), [](const Kept& k) { return !k.safe; });
  if (goes == kept_.end()) goes = kept_.begin();
  std::error_code ignored;
  std::filesystem::remove(copy_of(goes->number), ignored);
  kept_.erase(goes);
}

void BoxRecorder::end(const std::string& why) {
  if (why.empty()) {
    if (!pending_.empty()) copy_stop();
    writer_.remove();
    return;
  }
  writer_.note_stop(pending_.empty() ? why : why + "; " + pending_);
}

std::string fault_text(rt::FaultId id) {
  if (id == rt::kNoFault) return "no fault";
  for (const auto& row : tasks::kFaultTable) {
    if (row.id == id) return std::string(row.code) + " " + std::string(row.what);
  }
  return "fault " + std::to_string(id);
}

std::string cause_text(rt::FaultId id, const drivers::RobotState& robot) {
  const bool there = id == tasks::kFaultPeerStopped || id == tasks::kFaultPeerNotEngaged;
  if (!there || robot.mode_cause == rt::kNoFault) return fault_text(id);
  return fault_text(id) + " (there: " + fault_text(robot.mode_cause) + ")";
}

std::string fault_advice(rt::FaultId id) {
  const int row = tasks::fault_row(id);
  if (id == rt::kNoFault || row < 0) return "";
  return "; to do: " + std::string(tasks::kFaultTable[static_cast<std::size_t>(row)].advice);
}

namespace {

std::vector<std::string> files_in(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".blackbox") files.push_back(entry.path().string());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string why(const rt::BlackBox& box) {
  return box.stop.empty() ? "the process ended without a message (killed, or power lost)"
                          : box.stop;
}

}  // namespace

std::vector<std::string> black_boxes_in(const std::string& folder) {
  std::vector<std::string> out;
  for (const auto& file : files_in(folder)) {
    const auto box = rt::read_black_box(file);
    out.push_back(file + ": " + (box ? why(box.value()) : box.error()));
  }
  return out;
}

void say_black_boxes(const std::string& folder) {
  for (const auto& line : black_boxes_in(folder))
    std::fprintf(stderr, "teletact: black box %s\n", line.c_str());
}

void remove_black_boxes(const std::string& folder) {
  std::error_code ignored;
  for (const auto& file : files_in(folder)) std::filesystem::remove(file, ignored);
}

double seconds_of(const rt::BlackBox& box) noexcept {
  std::int64_t first = 0, last = 0;
  for (const auto& t : box.log.tasks) {
    for (const auto& j : t.jobs) {
      if (first == 0 || j.release_ns < first) first = j.release_ns;
      last = std::max(last, j.end_ns);
    }
  }
  return static_cast<double>(last - first) * 1e-9;
}

std::vector<std::string> events_of(const rt::BlackBox& box) {
  std::vector<std::pair<double, std::string>> events;
  for (const auto& e : box.entries) {
    if (e.tag != 'L') continue;
    std::string text(reinterpret_cast<const char*>(e.payload.data()), e.payload.size());
    std::replace_if(
        text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
    events.emplace_back(std::strtod(text.c_str(), nullptr), std::move(text));
  }
  constexpr const char* kSeverities[] = {"ok", "count", "degrade", "ramp down", "safe stop"};
  for (const auto& t : box.log.tasks) {
    rt::Health before;
    for (const auto& j : t.jobs) {
      const rt::Health now{j.severity, j.fault};
      if (now == before) continue;
      before = now;
      char time[32];
      std::snprintf(time, sizeof time, "%.9f ", static_cast<double>(j.end_ns) * 1e-9);
      const auto s = std::min<std::size_t>(static_cast<std::size_t>(now.severity), 4);
      std::string text = time + t.spec.name + ": health " + kSeverities[s];
      if (now.fault != rt::kNoFault) text += ", " + fault_text(now.fault);
      events.emplace_back(static_cast<double>(j.end_ns) * 1e-9, std::move(text));
    }
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::string> out;
  for (auto& e : events) out.push_back(std::move(e.second));
  return out;
}

void print_black_box(const std::string& path, const rt::BlackBox& box) {
  std::printf("%s: the last %.2f s, %llu records", path.c_str(), seconds_of(box),
              static_cast<unsigned long long>(box.records));
  if (box.missing > 0) std::printf(", %llu missing", static_cast<unsigned long long>(box.missing));
  std::printf("\nstopped: %s\n", why(box).c_str());
  constexpr std::size_t kLines = 40;
  const auto events = events_of(box);
  if (events.size() > kLines) std::printf("  ... %zu before\n", events.size() - kLines);
  for (std::size_t i = events.size() > kLines ? events.size() - kLines : 0; i < events.size(); ++i)
    std::printf("  %s\n", events[i].c_str());
  std::size_t inputs = 0;
  RecordingMark first, last;
  for (const auto& e : box.entries) {
    if (e.tag == 'I') ++inputs;
    if (e.tag != 'R' || e.payload.size() != sizeof last) continue;
    std::memcpy(&last, e.payload.data(), sizeof last);
    if (first.at_ns == 0) first = last;
  }
  std::printf("inputs of %zu jobs", inputs);
  if (last.at_ns != 0) {
    std::printf("; in the recording: ops %llu to %llu, messages %llu to %llu, frames %llu to %llu",
                static_cast<unsigned long long>(first.ops),
                static_cast<unsigned long long>(last.ops),
                static_cast<unsigned long long>(first.messages),
                static_cast<unsigned long long>(last.messages),
                static_cast<unsigned long long>(first.frames),
                static_cast<unsigned long long>(last.frames));
  }
  std::printf("\n");
}

}  // namespace teletact

#include "tools/touch/tick_file.hpp"

#include <cstring>
#include <stdexcept>
#include <utility>

#include "tools/touch/tick_codec.hpp"

namespace teletact {

using namespace haptic_run;
using perception::SurfacePatch;

namespace {

constexpr char kMagic[8] = {'t', 'e', 'l', 'e', 'h', 'a', 'p', 't'};
constexpr std::uint32_t kVersion = 1;
constexpr std::uint32_t kMostHeader = 1U << 16U;
constexpr std::uint32_t kMostRecord = 1U << 26U;

void write_all(std::FILE* file, const std::string& bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file) != bytes.size()) {
    throw std::runtime_error("haptic run: only a part could be written (disk full?)");
  }
}

}  // namespace

HapticRunTick run_tick(const rt::Tick& tick, const tasks::HapticTask::In& in,
                       const tasks::HapticTask::Out& out) noexcept {
  HapticRunTick t;
  t.tick = tick;
  t.stylus = in.stylus;
  t.stylus_ok = in.stylus_ok;
  t.clutch = in.clutch;
  t.view_yaw_rad = in.view_yaw_rad;
  t.mode = in.mode.mode;
  t.mode_seq = in.mode.seq;
  t.f_D = out.force.f_H_D;
  t.f_raw_D = out.telemetry.f_raw_D;
  t.p_WP = out.state.p_WP;
  t.p_WH = out.state.p_WH;
  t.contacts = out.state.contacts;
  t.in_contact = out.telemetry.in_contact;
  return t;
}

void set_inputs(const HapticRunTick& t, tasks::HapticTask::In& in) noexcept {
  in.stylus = t.stylus;
  in.stylus_ok = t.stylus_ok;
  in.clutch = t.clutch;
  in.view_yaw_rad = t.view_yaw_rad;
  in.mode.seq = t.mode_seq;
  in.mode.mode = t.mode;
}

HapticRunWriter::HapticRunWriter(std::FILE* file, const HapticRunHeader& header) : file_(file) {
  std::string body;
  put(body, header.period_s);
  put(body, header.origin);
  put_device(body, header.device);
  put_config(body, header.config);
  std::string all(kMagic, sizeof kMagic);
  put(all, kVersion);
  put(all, static_cast<std::uint32_t>(body.size()));
  write_all(file_, all + body);
}

void HapticRunWriter::record(char tag) {
  std::string head(1, tag);
  put(head, static_cast<std::uint32_t>(bytes_.size()));
  write_all(file_, head);
  write_all(file_, bytes_);
  bytes_.clear();
}

void HapticRunWriter::window(const SurfacePatch& p) {
  put_window(bytes_, p);
  record('W');
}

void HapticRunWriter::surface(const tasks::SurfacePoints& s) {
  put_surface(bytes_, s);
  record('S');
}

void HapticRunWriter::tick(const HapticRunTick& t) {
  put_tick(bytes_, t);
  record('T');
  ++ticks_;
}

void HapticRunWriter::finish() {
  put(bytes_, ticks_);
  record('E');
}

bool HapticRunReader::fetch(std::size_t n) {
  bytes_.resize(n);
  return std::fread(bytes_.data(), 1, n, file_) == n;
}

rt::Result<std::unique_ptr<HapticRunReader>> HapticRunReader::open(std::FILE* file,
                                                                   const std::string& name) {
  std::unique_ptr<HapticRunReader> r(new HapticRunReader(file, name));
  if (!r->fetch(16) || std::memcmp(r->bytes_.data(), kMagic, sizeof kMagic) != 0) {
    return r->error("is not a haptic run (teletact touch --record writes one)");
  }
  std::uint32_t version = 0, size = 0;
  std::memcpy(&version, r->bytes_.data() + 8, 4);
  std::memcpy(&size, r->bytes_.data() + 12, 4);
  if (version != kVersion) {
    return r->error("is a haptic run of version " + std::to_string(version) +
                    "; this program reads version " + std::to_string(kVersion));
  }
  if (size > kMostHeader || !r->fetch(size)) return r->error("its header is cut off");
  Cursor in(r->bytes_);
  auto& h = r->header_;
  if (!in.get(h.period_s) || !in.get(h.origin) || !get_device(in, h.device)) {
    return r->error("its header is damaged");
  }
  if (!(h.period_s >= 1e-5 && h.period_s <= 0.1)) {
    return r->error("has a period of " + std::to_string(h.period_s) +
                    " s; allowed are 10 us to 100 ms");
  }
  if (!(h.origin.norm() <= 1e6)) return r->error("has an origin beyond 1e6 m");
  const std::string wrong = get_config(in, h.config);
  if (!wrong.empty()) return r->error(wrong);
  if (!in.at_end()) return r->error("its header is damaged");
  return rt::Result<std::unique_ptr<HapticRunReader>>(std::move(r));
}

rt::Result<HapticRunReader::Kind> HapticRunReader::next(SurfacePatch& window,
                                                        tasks::SurfacePoints& surface,
                                                        HapticRunTick& tick) {
  char head[5];
  if (std::fread(head, 1, sizeof head, file_) != sizeof head) {
    return error("is cut off after " + std::to_string(ticks_) + " ticks");
  }
  std::uint32_t size = 0;
  std::memcpy(&size, head + 1, 4);
  if (size > kMostRecord || !fetch(size)) {
    return error("is cut off after " + std::to_string(ticks_) + " ticks");
  }
  Cursor in(bytes_);
  const auto damaged = [&](const char* what) {
    return error(std::string("has a damaged ") + what + " after " + std::to_string(ticks_) +
                 " ticks");
  };
  switch (head[0]) {
    case 'W':
      if (!get_window(in, window)) return damaged("window");
      return Kind::kWindow;
    case 'S':
      if (!get_surface(in, surface)) return damaged("ray cast");
      return Kind::kSurface;
    case 'T':
      if (!get_tick(in, tick)) return damaged("tick");
      ++ticks_;
      return Kind::kTick;
    case 'E': {
      std::uint64_t ticks = 0;
      if (!in.get(ticks) || !in.at_end() || ticks != ticks_) return damaged("end");
      if (std::fgetc(file_) != EOF) return error("more bytes after its end");
      return Kind::kEnd;
    }
    default:
      return damaged("record");
  }
}

OpenHapticRun::OpenHapticRun(const std::string& path)
    : file(std::fopen(path.c_str(), "rbe"), &std::fclose) {
  if (!file) throw std::runtime_error(path + ": cannot be opened");
  auto opened = HapticRunReader::open(file.get(), path);
  if (!opened) throw std::runtime_error(opened.error());
  reader = std::move(opened).value();
}

}  // namespace teletact

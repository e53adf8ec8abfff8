#include "tools/desk/link_now.hpp"

namespace teletact {

LinkNow link_now(std::span<const tasks::LinkSample> samples, rt::Time now) {
  LinkNow l;
  std::uint64_t bytes = 0, pictures = 0;
  const auto age_ms = [now](rt::Time made) { return 1e3 * rt::seconds(now - made); };
  for (auto s = samples.rbegin(); s != samples.rend(); ++s) {
    const bool counts = s->stamp > now - LinkNow::kWindow;
    // Nothing for longer than the window: how old the newest is, is what matters then.
    if (!counts && l.picture_age_ms >= 0 && l.state_age_ms >= 0) break;
    if (counts) {
      bytes += s->bytes;
      pictures += s->picture ? 1 : 0;
    }
    double& age = s->picture ? l.picture_age_ms : l.state_age_ms;
    if (age < 0) age = age_ms(s->made);
  }
  const double window_s = rt::seconds(LinkNow::kWindow);
  l.fps = static_cast<double>(pictures) / window_s;
  l.mbit_s = 8e-6 * static_cast<double>(bytes) / window_s;
  return l;
}

void PictureLoss::see(std::uint64_t number, std::uint64_t arrived, rt::Time now) {
  const bool anew =
      !seen_.empty() && (number < seen_.back().number || arrived < seen_.back().arrived);
  if (anew) seen_.clear();
  if (!seen_.empty() && number == seen_.back().number) return;
  seen_.push_back({now, number, arrived});
  while (seen_.front().at <= now - LinkNow::kWindow) seen_.pop_front();
}

double PictureLoss::share() const {
  if (seen_.size() < 2) return -1;
  const auto of_camera = seen_.back().number - seen_.front().number;
  const auto of_link = seen_.back().arrived - seen_.front().arrived;
  if (of_camera == 0 || of_link > of_camera) return 0;
  return static_cast<double>(of_camera - of_link) / static_cast<double>(of_camera);
}

}  // namespace teletact

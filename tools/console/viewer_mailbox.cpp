#include "tools/console/viewer_mailbox.hpp"

#include <utility>

namespace teletact {

bool ViewerMailbox::put(ViewKind kind, ViewBytes view) {
  ViewBytes& slot = newest_[static_cast<std::size_t>(kind)];
  const bool replaced = slot != nullptr;
  slot = std::move(view);
  return replaced;
}

bool ViewerMailbox::put_answer(ViewBytes answer) {
  if (answer_bytes_ + answer->size() > kMostAnswerBytes) return false;
  answer_bytes_ += answer->size();
  answers_.push_back(std::move(answer));
  return true;
}

ViewBytes ViewerMailbox::next(const ConsoleMesh& mesh, bool bulk) {
  if (!answers_.empty()) {
    ViewBytes first = std::move(answers_.front());
    answers_.pop_front();
    answer_bytes_ -= first->size();
    return first;
  }
  for (std::size_t n = 0; n < kViewKinds; ++n) {
    turn_ = (turn_ + 1) % kViewKinds;
    if (!bulk && is_bulk(static_cast<ViewKind>(turn_))) continue;
    if (turn_ == static_cast<std::size_t>(ViewKind::kMesh)) {
      if (ViewBytes part = mesh.next(cursor_)) return part;
    } else if (newest_[turn_]) {
      return std::exchange(newest_[turn_], nullptr);
    }
  }
  return nullptr;
}

std::size_t ViewerMailbox::bytes() const noexcept {
  std::size_t sum = answer_bytes_;
  for (const ViewBytes& v : newest_) sum += v ? v->size() : 0;
  return sum;
}

}  // namespace teletact

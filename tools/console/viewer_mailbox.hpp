// What waits for one viewer. Of each kind the newest view; answers in order, with a cap; a cursor
// in the mesh. Answers go first; the kinds take turns, so a large one starves no other.
#pragma once

#include <array>
#include <cstddef>
#include <deque>

#include "tools/console/console_mesh.hpp"
#include "tools/console/view_bytes.hpp"

namespace teletact {

class ViewerMailbox {
 public:
  static constexpr std::size_t kMostAnswerBytes = std::size_t{256} << 10U;

  // True: an older one of its kind had not left, and never will.
  bool put(ViewKind kind, ViewBytes view);
  // False: too many wait; this viewer does not read.
  [[nodiscard]] bool put_answer(ViewBytes answer);
  // What is to leave next; null: nothing. Without `bulk` none of the large kinds (is_bulk).
  [[nodiscard]] ViewBytes next(const ConsoleMesh& mesh, bool bulk = true);
  [[nodiscard]] std::size_t bytes() const noexcept;  // of what waits, mesh apart

 private:
  std::array<ViewBytes, kViewKinds> newest_;
  std::deque<ViewBytes> answers_;
  std::size_t answer_bytes_ = 0, turn_ = 0;
  ConsoleMesh::Cursor cursor_;
};

}  // namespace teletact

// What a person is told of a link that lasts: that it waits, that the other box is there, and why
// it has gone. One line each time that this changes. And, once a second at most, that commands were
// refused; and what is lowered of the pictures, why, and that it is whole again.
#pragma once

#include <cstdint>
#include <string>

#include "drivers/link/link_transport.hpp"
#include "tasks/graph/operator_graph.hpp"
#include "tools/pictures/picture_words.hpp"

namespace teletact {

class LinkNews {
 public:
  // Prints to stdout unless `quiet`.
  void look(const drivers::LinkTransport& link, const tasks::LinkStatus& status, bool quiet);
  // The line that is due, or empty.
  [[nodiscard]] std::string refused_line(std::uint64_t refused, const char* newest,
                                         std::int64_t now_ns);
  [[nodiscard]] std::string line(bool ready, std::uint64_t sessions, const std::string& fault);

 private:
  SparedNews spared_news_;
  std::string told_fault_;
  bool begun_ = false, was_ready_ = false;
  std::uint64_t sessions_ = 0, refused_ = 0;
  std::int64_t next_refused_ns_ = 0;
};

}  // namespace teletact

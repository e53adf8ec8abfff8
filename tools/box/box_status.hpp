// What a running box says of itself to its own user: a Unix socket, answered by the box's ordinary
// thread, read by `teletact status`. Who connects is sent one JSON object, and the connection ends.
// The box reads nothing from it.
//
// $XDG_RUNTIME_DIR/teletact/robot.sock or operator.sock, mode 0600, in a folder of mode 0700; the
// peer's user is checked too (SO_PEERCRED), on both sides.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "rt/result.hpp"

namespace teletact {

struct BoxStatus {
  std::string box, version;  // "robot" or "operator"
  int pid = 0;
  double up_s = 0;                // since the epoch
  std::string mode, cause;        // cause: empty, or "F-SUP-02 the link is silent ..."
  std::string link;               // "connected", "hand-shake", "no other box"
  std::string link_fault;         // why there is none, or why the last one ended
  std::uint64_t connections = 0;  // so far
  std::string
      peer;  // "operator 'ada' from 10.0.0.3", from the hand-shake on; empty: nobody, or no TLS
  std::uint64_t turned_away = 0;        // connections that this box refused (TLS)
  std::string turned_away_newest;       // from where, and why
  std::string link_note;                // how certificates are judged where that is not as usual
  std::string certificate_until;        // of this box, a day; empty: it has none
  double heard_ago_ms = -1;             // last valid message of the other box; below 0: never
  double round_trip_ms = -1;            // below 0: not measured
  std::string congestion;               // of the kernel, read back; empty: no session, or no TLS
  double picture_age_ms = -1;           // on the operator's box, since the exposure; below 0: none
  double pictures_per_s = -1;           // over the last second; below 0: not known
  double rate_Mbit_per_s = 0;           // what the road is said to carry; 0: not paced, or no TLS
  std::string pictures;                 // what is lowered, why, when it comes back; else "whole"
  std::uint64_t commands_refused = 0;   // by the robot's box, as this box knows it
  std::string commands_refused_reason;  // of the newest
  std::string real_time;                // "yes", or "no: " and what the machine refused
  double store_MiB = 0, store_cap_MiB = 0;  // of the job records
  double disk_free_MiB = -1;                // where they are; below 0: not known
  std::string report;                       // folder
};
[[nodiscard]] std::string status_json(const BoxStatus& status);
// The object that status_json() wrote, one "key  value" a line. Anything else is an error.
[[nodiscard]] rt::Result<std::string> status_text(const std::string& json);

// Of this user. The error says that XDG_RUNTIME_DIR is not set, or not an absolute path.
[[nodiscard]] rt::Result<std::string> status_socket(const std::string& box);

class StatusServer {
 public:
  // Takes the place of a socket that nobody answers any more. Refused: another box answers there.
  [[nodiscard]] static rt::Result<StatusServer> open(const std::string& path);
  ~StatusServer();
  StatusServer(StatusServer&& other) noexcept;
  StatusServer& operator=(StatusServer&&) = delete;
  StatusServer(const StatusServer&) = delete;
  StatusServer& operator=(const StatusServer&) = delete;

  // Answers who waits, and waits for nobody. `json` is asked once for each answer.
  void serve(const std::function<std::string()>& json) const;

 private:
  StatusServer(int fd, std::string path) noexcept : fd_(fd), path_(std::move(path)) {}
  int fd_ = -1;
  std::string path_;
};

// The JSON of the box that answers there. The error names the socket.
[[nodiscard]] rt::Result<std::string> ask_status(const std::string& path);

}  // namespace teletact

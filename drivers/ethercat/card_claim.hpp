// One program owns a network card: a second master on it would take the slaves of the first one to
// INIT, and an arm would go limp.
//
//   claim    Abstract Unix sockets, named by the card's index and by its name (unix(7)). They have
//            the reach of the card itself, its network namespace; they need no file, no folder and
//            no right, hold across users, and are gone with their process, however it ended. The
//            state of a slave is no claim: a crash leaves slaves in SAFEOP.
//   listen   A master that makes no such claim (another program, another computer on the cable) is
//            heard: slaves send nothing by themselves, so that every EtherCAT frame is a master's.
//
// A claim keeps nobody away by force. Whoever only looks (capture, AL states, registers) makes
// none. Any user of the machine may make one, and so may keep a robot from starting.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>

#include "rt/memory/non_realtime.hpp"
#include "rt/result.hpp"
#include "rt/time.hpp"

namespace drivers::ethercat {

struct CardOwner {
  int pid = 0;       // 0: not known
  std::string name;  // "teletact robot"; "a program": not known
  // "teletact robot (pid 4711)"
  [[nodiscard]] std::string text() const;
};

class CardClaim {
 public:
  // The error names the interface, and the owner where there is one.
  [[nodiscard]] static rt::Result<std::unique_ptr<CardClaim>> take(rt::NonRealtime&,
                                                                   const std::string& interface);
  ~CardClaim();
  CardClaim(const CardClaim&) = delete;
  CardClaim& operator=(const CardClaim&) = delete;

 private:
  CardClaim() = default;
  std::array<int, 3> sockets_{-1, -1, -1};  // by index, by name, and the one that says whose it is
};

// Who has claimed the card; nullopt: nobody.
[[nodiscard]] std::optional<CardOwner> card_owner(rt::NonRealtime&, const std::string& interface);

// Listens for `time`, and once more where a frame was heard: a look of another program is over by
// then, a master goes on. True: a master is at work. Takes `time` if the card is silent. The error
// names the interface and, without the right, CAP_NET_RAW.
[[nodiscard]] rt::Result<bool> hears_a_master(rt::NonRealtime&, const std::string& interface,
                                              rt::Nanos time = std::chrono::milliseconds{200});

// For who is going to write: the claim, and a card on which no master was heard.
[[nodiscard]] rt::Result<std::unique_ptr<CardClaim>> claim_silent_card(
    rt::NonRealtime&, const std::string& interface);

// Why a card can not be used, in one line, with what to do.
// Of a failed call (errno): the right that is missing, a name that is not there.
[[nodiscard]] std::string card_problem(const std::string& interface, int error);

// Of a card that is down: the command that sets it up. Empty: it is up, or can not be asked.
[[nodiscard]] std::string card_down(const std::string& interface);

// Of the words of a process (argv, each ended by a zero byte): the program's name without its path,
// and the first word behind it unless that is an option. Any bytes; empty: there is no name.
[[nodiscard]] std::string program_name(std::string_view words);

}  // namespace drivers::ethercat

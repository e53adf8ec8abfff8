// One program owns a network card: in a network of its own, where this user may make one.
#include "drivers/ethercat/card_claim.hpp"

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <functional>

#include "drivers/ethercat/frame.hpp"
#include "drivers/ethercat/raw_port.hpp"
#include "rt/random.hpp"

namespace {

using namespace drivers::ethercat;
using namespace std::chrono_literals;

// Runs `body` in a child with a pair of cards, cc0 and cc1, that are up. What it returns, 0 to 99;
// nullopt: there is no such right here.
std::optional<int> with_cards(const std::function<int(rt::NonRealtime&)>& body) {
  const pid_t child = ::fork();
  if (child == 0) {
    if (::unshare(CLONE_NEWNET) != 0 ||
        std::system("ip link add cc0 type veth peer name cc1 2>/dev/null && "
                    "ip link set cc0 up && ip link set cc1 up") != 0)
      ::_exit(100);
    rt::Startup startup;
    ::_exit(body(startup.token()));
  }
  int status = 0;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 100) return std::nullopt;
  return WEXITSTATUS(status);
}

#define SKIP_WITHOUT_CARDS(code) \
  if (!(code)) GTEST_SKIP() << "no network of its own here"

// A process that claims the card and stands. Its pid; it says through `ready` that it has it.
pid_t claimant(const std::string& card) {
  int ready[2];
  if (::pipe(ready) != 0) return -1;
  const pid_t pid = ::fork();
  if (pid == 0) {
    rt::Startup startup;
    const auto claim = CardClaim::take(startup.token(), card);
    const char had = claim ? '1' : '0';
    if (::write(ready[1], &had, 1) != 1) ::_exit(1);
    for (;;) ::pause();
  }
  char had = 0;
  const bool told = ::read(ready[0], &had, 1) == 1;
  return told && had == '1' ? pid : -1;
}

TEST(CardClaim, TheSecondOneIsToldWhoHasItUntilThatOneIsKilled) {
  const auto code = with_cards([](rt::NonRealtime& nrt) {
    const pid_t first = claimant("cc0");
    if (first < 0) return 1;
    const auto second = CardClaim::take(nrt, "cc0");
    if (second) return 2;
    if (second.error().find("(pid " + std::to_string(first) + ") owns it") == std::string::npos ||
        second.error().find("interface cc0: ") != 0)
      return 3;
    const auto owner = card_owner(nrt, "cc0");
    if (!owner || owner->pid != first || owner->name.empty()) return 4;
    if (card_owner(nrt, "cc1") || !CardClaim::take(nrt, "cc1")) return 5;
    // Under another name it is the same card.
    if (std::system("ip link set cc0 down && ip link set cc0 name cc7 && ip link set cc7 up") != 0)
      return 6;
    if (CardClaim::take(nrt, "cc7")) return 7;
    ::kill(first, SIGKILL);
    ::waitpid(first, nullptr, 0);
    if (card_owner(nrt, "cc7")) return 8;
    return CardClaim::take(nrt, "cc7") ? 0 : 9;
  });
  SKIP_WITHOUT_CARDS(code);
  EXPECT_EQ(*code, 0);
}

// Another user's claim holds too.
TEST(CardClaim, ItHoldsAcrossUsers) {
  const auto code = with_cards([](rt::NonRealtime& nrt) {
    const auto mine = CardClaim::take(nrt, "cc0");
    if (!mine) return 1;
    const pid_t other = ::fork();
    if (other == 0) {
      if (::setuid(65534) != 0) ::_exit(3);
      ::_exit(CardClaim::take(nrt, "cc0") ? 2 : 0);
    }
    int status = 0;
    ::waitpid(other, &status, 0);
    return WEXITSTATUS(status) == 3 ? 0 : WEXITSTATUS(status);
  });
  SKIP_WITHOUT_CARDS(code);
  EXPECT_EQ(*code, 0);
}

// A process that sends a frame every `period` at the other end of the cable, so many of them.
pid_t sender(const std::string& card, rt::Nanos period, int frames) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    rt::Startup startup;
    const auto port = RawPort::open(startup.token(), card);
    FrameWriter writer;
    if (!port || !writer.add(Command::kBrd, 1, 0, 1)) ::_exit(1);
    for (int i = 0; i < frames; ++i) {
      (void)port.value()->send(writer.finish());
      port.value()->sleep_until(port.value()->now() + period);
    }
    ::_exit(0);
  }
  return pid;
}

// Both ways: a master behind the cable, and another program on this card.
TEST(CardClaim, AMasterThatClaimsNothingIsHeard) {
  for (const char* card : {"cc1", "cc0"}) {
    const auto code = with_cards([&](rt::NonRealtime& nrt) {
      const auto silent = hears_a_master(nrt, "cc0");
      if (!silent || silent.value()) return 1;
      const pid_t master = sender(card, 20ms, 1'000'000);
      const auto heard = hears_a_master(nrt, "cc0");
      const auto refused = claim_silent_card(nrt, "cc0");
      ::kill(master, SIGKILL);
      ::waitpid(master, nullptr, 0);
      if (!heard || !heard.value()) return 2;
      if (refused || refused.error().find("another master") == std::string::npos) return 3;
      return claim_silent_card(nrt, "cc0") ? 0 : 4;
    });
    SKIP_WITHOUT_CARDS(code);
    EXPECT_EQ(*code, 0) << card;
  }
}

// `ethercat state` of a neighbour: some frames at once, and then none.
TEST(CardClaim, ALookIsNoMaster) {
  const auto code = with_cards([](rt::NonRealtime& nrt) {
    const pid_t look = sender("cc0", 100us, 30);
    const auto heard = hears_a_master(nrt, "cc0");
    ::waitpid(look, nullptr, 0);
    return heard && !heard.value() ? 0 : 1;
  });
  SKIP_WITHOUT_CARDS(code);
  EXPECT_EQ(*code, 0);
}

TEST(RawPort, OfACardThatIsDownTheErrorIsTheCommandThatSetsItUp) {
  const auto code = with_cards([](rt::NonRealtime& nrt) {
    if (std::system("ip link set cc0 down") != 0) return 1;
    const auto port = RawPort::open(nrt, "cc0");
    return !port && port.error() == "interface cc0: is down: sudo ip link set cc0 up" ? 0 : 2;
  });
  SKIP_WITHOUT_CARDS(code);
  EXPECT_EQ(*code, 0);
}

TEST(CardClaim, NamesAProcessByItsWords) {
  using namespace std::string_view_literals;
  EXPECT_EQ(program_name("/opt/teletact/bin/teletact\0robot\0--robot\0r.toml\0"sv),
            "teletact robot");
  EXPECT_EQ(program_name("simple_test\0eth1\0"sv), "simple_test eth1");
  EXPECT_EQ(program_name("master\0--iface\0"sv), "master");
  EXPECT_EQ(program_name("a\x1b[2J\0"sv), "a?[2J");
  EXPECT_EQ(program_name(""sv), "");
  EXPECT_EQ(program_name("\0\0"sv), "");
  rt::Random random{61};  // any bytes: what comes out is short and can be printed
  for (int i = 0; i < 20000; ++i) {
    std::string words(static_cast<std::size_t>(120 * random.uniform()), '\0');
    for (char& c : words) c = static_cast<char>(256 * random.uniform());
    const std::string name = program_name(words);
    ASSERT_LE(name.size(), 81U) << "seed 61, round " << i;
    for (const char c : name) ASSERT_TRUE(c >= ' ' && c <= '~') << "seed 61, round " << i;
  }
}

}  // namespace

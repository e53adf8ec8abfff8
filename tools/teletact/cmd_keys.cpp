// teletact keys: the lab's CA and the certificates of its boxes. docs/security.md.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivers/road/pem.hpp"
#include "tools/cli/options.hpp"
#include "tools/keys/key_lab.hpp"
#include "tools/keys/web_lab.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {

namespace {

constexpr std::int64_t kDay_s = 86400;

struct KeysOptions {
  std::string folder = "keys", name, role, what;
  std::vector<std::string> hosts;
  int days = 0, warn_days = 30;
  bool new_key = false, revoke = false;
};

std::int64_t now_s() { return std::time(nullptr); }

template <class T>
T value_of(rt::Result<T> result) {
  if (!result) throw std::runtime_error(result.error());
  return std::move(result).value();
}

std::string until_text(std::int64_t until_s) {
  const std::int64_t left = until_s - now_s();
  if (left < 0) return "expired on " + drivers::day_of(until_s);
  return "until " + drivers::day_of(until_s) + ", " + std::to_string(left / kDay_s) + " days left";
}

void init(const KeysOptions& o) {
  const int days = o.days > 0 ? o.days : KeyLab::kDaysCa;
  value_of(KeyLab::init(o.folder, o.name, days, now_s()));
  std::printf("CA '%s' in %s, %s\n%s/ca.key makes certificates: it stays here\n", o.name.c_str(),
              o.folder.c_str(), until_text(now_s() + days * kDay_s).c_str(), o.folder.c_str());
}

void tell_box(const std::string& folder) {
  const auto c = value_of(drivers::read_certificate(folder + "/box.crt"));
  const auto peer = value_of(drivers::read_peer(*c));
  std::printf("%s '%s', certificate %s, %s\nput the folder %s on that box, nowhere else\n",
              drivers::role_name(peer.role), peer.name.c_str(), peer.serial.c_str(),
              until_text(peer.valid_until_s).c_str(), folder.c_str());
}

void issue(const KeysOptions& o) {
  const auto role = o.role == "robot" ? rt::Box::kRobot : rt::Box::kOperator;
  auto lab = value_of(KeyLab::open(o.folder));
  tell_box(value_of(lab.issue(role, o.name, o.days > 0 ? o.days : KeyLab::kDaysBox, now_s())));
}

void renew(const KeysOptions& o) {
  auto lab = value_of(KeyLab::open(o.folder));
  tell_box(value_of(lab.renew(o.name, o.days > 0 ? o.days : KeyLab::kDaysBox, o.new_key, now_s())));
}

void revoke(const KeysOptions& o) {
  auto lab = value_of(KeyLab::open(o.folder));
  const int n = value_of(lab.revoke(o.name, now_s()));
  if (n == 0) {
    std::printf("'%s': everything of that name was revoked before\n", o.name.c_str());
    return;
  }
  std::printf(
      "'%s': %d certificate%s revoked\nput %s/ca.crl on every box, in place of its ca.crl: "
      "a running box reads it within a second and closes the session\n",
      o.name.c_str(), n, n == 1 ? "" : "s", o.folder.c_str());
}

void web(const KeysOptions& o) {
  auto lab = value_of(WebLab::open(o.folder, now_s()));
  const int days = o.days > 0 ? o.days : WebLab::kDaysWeb;
  const std::string box = value_of(lab.issue_web(o.name, o.hosts, days, now_s()));
  std::printf(
      "console of '%s', %s\nput the folder %s on that box, nowhere else\n"
      "put %s/web/ca.crt into each browser or tablet, as a CA that it trusts\n",
      o.name.c_str(), until_text(now_s() + days * kDay_s).c_str(), box.c_str(), o.folder.c_str());
}

void browser(const KeysOptions& o) {
  auto lab = value_of(WebLab::open(o.folder, now_s()));
  if (o.revoke) {
    const int n = value_of(lab.revoke(o.name, now_s()));
    std::printf(
        "'%s': %d certificate%s revoked\nput %s/web/ca.crl on every box, beside its web.crt\n",
        o.name.c_str(), n, n == 1 ? "" : "s", o.folder.c_str());
    return;
  }
  const int days = o.days > 0 ? o.days : WebLab::kDaysWeb;
  const auto made = value_of(lab.issue_browser(o.name, days, now_s()));
  std::printf(
      "browser '%s', %s\nput %s and %s/web/ca.crt on that device; it asks for this password, which "
      "is told only now: %s\nthen remove the file\n",
      o.name.c_str(), until_text(now_s() + days * kDay_s).c_str(), made.file.c_str(),
      o.folder.c_str(), made.password.c_str());
}

int list_web(const KeysOptions& o) {
  if (!WebLab::is_there(o.folder)) return 0;
  const auto rows = value_of(value_of(WebLab::open(o.folder, now_s())).list());
  int soon = 0;
  for (const WebRow& row : rows) {
    const std::int64_t left_s = row.until_s - now_s();
    soon += !row.revoked && left_s > 0 && left_s < o.warn_days * kDay_s ? 1 : 0;
    std::printf("%-20s %-9s %-33s %s\n", row.name.c_str(), row.unit.c_str(), row.serial.c_str(),
                row.revoked ? "revoked" : until_text(row.until_s).c_str());
  }
  return soon;
}

// 1: something that is in use ends soon, or has ended.
int list(const KeysOptions& o) {
  const auto lab = value_of(KeyLab::open(o.folder));
  const auto rows = value_of(lab.list());
  int soon = 0;
  std::printf("%-20s %-9s %-33s %s\n", "name", "role", "certificate", "state");
  for (const IssuedRow& row : rows) {
    const bool ends =
        row.current && !row.revoked && row.box.valid_until_s - now_s() < o.warn_days * kDay_s;
    soon += ends ? 1 : 0;
    const std::string state = row.revoked   ? "revoked"
                              : row.current ? until_text(row.box.valid_until_s)
                                            : "replaced; " + until_text(row.box.valid_until_s);
    std::printf("%-20s %-9s %-33s %s%s\n", row.box.name.c_str(), drivers::role_name(row.box.role),
                row.box.serial.c_str(), state.c_str(), ends ? ": teletact keys renew" : "");
  }
  soon += list_web(o);
  const bool ca_ends = lab.ca_until_s() - now_s() < o.warn_days * kDay_s;
  std::printf("CA: %s%s\n", until_text(lab.ca_until_s()).c_str(),
              ca_ends ? ": a new lab is needed" : "");
  return soon > 0 || ca_ends ? 1 : 0;
}

void show(const KeysOptions& o) {
  const auto c = value_of(drivers::read_certificate(o.what));
  const auto peer = value_of(drivers::read_peer(*c));
  std::printf(
      "name         %s\nrole         %s\ncertificate  %s\nkey          sha256:%s\nvalid        "
      "%s\n",
      peer.name.c_str(), drivers::role_name(peer.role), peer.serial.c_str(),
      peer.key_sha256.c_str(), until_text(peer.valid_until_s).c_str());
}

}  // namespace

int cmd_keys(int argc, char** argv) {
  KeysOptions o;
  CLI::App app("The lab's CA and the certificates of its boxes", "teletact keys");
  app.require_subcommand(1);
  const auto action = [&](const char* name, const char* help) {
    CLI::App* a = app.add_subcommand(name, help);
    if (std::string(name) != "show")
      a->add_option("--folder", o.folder, "of the lab")->capture_default_str();
    return a;
  };
  CLI::App* const to_init = action("init", "make a lab: a CA, and an empty list of revoked ones");
  to_init->add_option("name", o.name, "of the lab")->required();
  CLI::App* const to_issue = action("issue", "a key and a certificate for a box");
  to_issue->add_option("role", o.role, "robot or operator")
      ->required()
      ->check(CLI::IsMember({"robot", "operator"}));
  to_issue->add_option("name", o.name, "of the box")->required();
  CLI::App* const to_renew = action("renew", "a new certificate for a box that has one");
  to_renew->add_option("name", o.name, "of the box")->required();
  to_renew->add_flag("--new-key", o.new_key,
                     "with a new key: update every peer that pins the old key");
  for (CLI::App* a : {to_init, to_issue, to_renew})
    a->add_option("--days", o.days, "it is valid (CA 3650, box 365)")
        ->check(CLI::Range(1, KeyLab::kMostDays));
  CLI::App* const to_revoke = action("revoke", "no box lets it in any more");
  to_revoke->add_option("name", o.name, "of the box")->required();
  CLI::App* const to_web = action("web", "a certificate for the console of a box, for browsers");
  to_web->add_option("name", o.name, "of the box")->required();
  to_web->add_option("host", o.hosts, "names and addresses by which browsers reach it")->required();
  CLI::App* const to_browser = action("browser", "a certificate for a browser or tablet");
  to_browser->add_option("name", o.name, "of the browser")->required();
  to_browser->add_flag("--revoke", o.revoke, "no console lets it in any more");
  for (CLI::App* a : {to_web, to_browser})
    a->add_option("--days", o.days, "it is valid (365)")->check(CLI::Range(1, WebLab::kMostDays));
  CLI::App* const to_list = action("list", "what was issued, and what expires when");
  to_list->add_option("--warn-days", o.warn_days, "exit 1 where something ends sooner")
      ->check(CLI::Range(0, KeyLab::kMostDays))
      ->capture_default_str();
  CLI::App* const to_show = action("show", "what a certificate says");
  to_show->add_option("file", o.what, "box.crt")->required();
  if (!parse_options(app, argc, argv)) return 0;
  if (*to_list) return list(o);
  if (*to_web || *to_browser) {
    (*to_web ? web : browser)(o);
    return 0;
  }
  (*to_init ? init : *to_issue ? issue : *to_renew ? renew : *to_revoke ? revoke : show)(o);
  return 0;
}

}  // namespace teletact

#include "tools/keys/key_actions.hpp"

#include <cstdio>
#include <ctime>
#include <stdexcept>

#include "drivers/road/pem.hpp"
#include "tools/keys/key_lab.hpp"
#include "tools/keys/web_lab.hpp"

namespace teletact {

namespace {

constexpr std::int64_t kOneDay_s = 86400;

std::int64_t now_s() { return std::time(nullptr); }

template <class T>
T value_of(rt::Result<T> result) {
  if (!result) throw std::runtime_error(result.error());
  return std::move(result).value();
}

std::string until_text(std::int64_t until_s) {
  const std::int64_t left = until_s - now_s();
  if (left < 0) return "expired on " + drivers::day_of(until_s);
  return "until " + drivers::day_of(until_s) + ", " + std::to_string(left / kOneDay_s) +
         " days left";
}

void tell_box(const std::string& folder) {
  const auto c = value_of(drivers::read_certificate(folder + "/box.crt"));
  const auto peer = value_of(drivers::read_peer(*c));
  std::printf("%s '%s', certificate %s, %s\nput the folder %s on that box, nowhere else\n",
              drivers::role_name(peer.role), peer.name.c_str(), peer.serial.c_str(),
              until_text(peer.valid_until_s).c_str(), folder.c_str());
}

int list_web(const KeysOptions& o) {
  if (!WebLab::is_there(o.folder)) return 0;
  const auto rows = value_of(value_of(WebLab::open(o.folder, now_s())).list());
  int soon = 0;
  for (const WebRow& row : rows) {
    const std::int64_t left_s = row.until_s - now_s();
    soon += !row.revoked && left_s > 0 && left_s < o.warn_days * kOneDay_s ? 1 : 0;
    std::printf("%-20s %-9s %-33s %s\n", row.name.c_str(), row.unit.c_str(), row.serial.c_str(),
                row.revoked ? "revoked" : until_text(row.until_s).c_str());
  }
  return soon;
}

}  // namespace

void init_lab(const KeysOptions& o) {
  const int days = o.days > 0 ? o.days : KeyLab::kDaysCa;
  value_of(KeyLab::init(o.folder, o.name, days, now_s()));
  std::printf("CA '%s' in %s, %s\n%s/ca.key makes certificates: it stays here\n", o.name.c_str(),
              o.folder.c_str(), until_text(now_s() + days * kOneDay_s).c_str(), o.folder.c_str());
}

void issue_box(const KeysOptions& o) {
  const auto role = o.role == "robot" ? rt::Box::kRobot : rt::Box::kOperator;
  auto lab = value_of(KeyLab::open(o.folder));
  tell_box(value_of(lab.issue(role, o.name, o.days > 0 ? o.days : KeyLab::kDaysBox, now_s())));
}

void renew_box(const KeysOptions& o) {
  auto lab = value_of(KeyLab::open(o.folder));
  tell_box(value_of(lab.renew(o.name, o.days > 0 ? o.days : KeyLab::kDaysBox, o.new_key, now_s())));
}

void revoke_box(const KeysOptions& o) {
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

void issue_web(const KeysOptions& o) {
  auto lab = value_of(WebLab::open(o.folder, now_s()));
  const int days = o.days > 0 ? o.days : WebLab::kDaysWeb;
  const std::string box = value_of(lab.issue_web(o.name, o.hosts, days, now_s()));
  std::printf(
      "console of '%s', %s\nput the folder %s on that box, nowhere else\n"
      "put %s/web/ca.crt into each browser or tablet, as a CA that it trusts\n",
      o.name.c_str(), until_text(now_s() + days * kOneDay_s).c_str(), box.c_str(),
      o.folder.c_str());
}

void issue_browser(const KeysOptions& o) {
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
      o.name.c_str(), until_text(now_s() + days * kOneDay_s).c_str(), made.file.c_str(),
      o.folder.c_str(), made.password.c_str());
}

int list_keys(const KeysOptions& o) {
  const auto lab = value_of(KeyLab::open(o.folder));
  const auto rows = value_of(lab.list());
  int soon = 0;
  std::printf("%-20s %-9s %-33s %s\n", "name", "role", "certificate", "state");
  for (const IssuedRow& row : rows) {
    const bool ends =
        row.current && !row.revoked && row.box.valid_until_s - now_s() < o.warn_days * kOneDay_s;
    soon += ends ? 1 : 0;
    const std::string state = row.revoked   ? "revoked"
                              : row.current ? until_text(row.box.valid_until_s)
                                            : "replaced; " + until_text(row.box.valid_until_s);
    std::printf("%-20s %-9s %-33s %s%s\n", row.box.name.c_str(), drivers::role_name(row.box.role),
                row.box.serial.c_str(), state.c_str(), ends ? ": teletact keys renew" : "");
  }
  soon += list_web(o);
  const bool ca_ends = lab.ca_until_s() - now_s() < o.warn_days * kOneDay_s;
  std::printf("CA: %s%s\n", until_text(lab.ca_until_s()).c_str(),
              ca_ends ? ": a new lab is needed" : "");
  return soon > 0 || ca_ends ? 1 : 0;
}

void show_certificate(const KeysOptions& o) {
  const auto c = value_of(drivers::read_certificate(o.what));
  const auto peer = value_of(drivers::read_peer(*c));
  std::printf(
      "name         %s\nrole         %s\ncertificate  %s\nkey          sha256:%s\nvalid        "
      "%s\n",
      peer.name.c_str(), drivers::role_name(peer.role), peer.serial.c_str(),
      peer.key_sha256.c_str(), until_text(peer.valid_until_s).c_str());
}

}  // namespace teletact

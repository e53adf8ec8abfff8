#include "tools/keys/key_lab.hpp"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "tools/keys/certificate_maker.hpp"
#include "tools/keys/key_files.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kDay_s = 86400;
// The clocks of boxes differ: what is issued now is valid at once.
constexpr std::int64_t kBefore_s = 3600;

rt::Result<bool> good_days(int days) {
  if (days >= 1 && days <= KeyLab::kMostDays) return true;
  return rt::Error{"--days " + std::to_string(days) + ": allowed 1.." +
                   std::to_string(KeyLab::kMostDays)};
}

rt::Result<bool> good_name(const std::string& name) {
  if (drivers::good_box_name(name)) return true;
  return rt::Error{"name '" + name +
                   "': allowed 1 to 40 letters, digits, '.', '_', '-', not '.' or '-' first"};
}

}  // namespace

rt::Result<bool> KeyLab::init(const std::string& folder, const std::string& name, int days,
                              std::int64_t now_s) {
  if (auto ok = good_name(name); !ok) return ok;
  if (auto ok = good_days(days); !ok) return ok;
  for (const char* file : {"/ca.key", "/ca.crt", "/ca.crl"}) {
    if (fs::exists(folder + file))
      return rt::Error{folder + file + ": is there already and is not overwritten"};
  }
  auto key = make_key();
  if (!key) return rt::Error{key.error()};
  EVP_PKEY& k = *key.value();
  auto ca = make_certificate({name, "lab", now_s - kBefore_s, now_s + days * kDay_s, true}, k,
                             nullptr, k);
  if (!ca) return rt::Error{ca.error()};
  auto list = make_revoked(*ca.value(), k, {}, 1, now_s - kBefore_s);
  if (!list) return rt::Error{list.error()};
  std::error_code failed;
  const bool made = fs::create_directories(folder, failed);
  if (failed) return rt::Error{folder + ": " + failed.message()};
  if (made) fs::permissions(folder, fs::perms::owner_all, failed);
  for (const char* inner : {"/certificates", "/boxes"}) {
    if (auto ok = make_key_folder(folder + inner); !ok) return ok;
  }
  if (auto ok = write_key_file(folder + "/ca.key", pem_of(k)); !ok) return ok;
  if (auto ok = write_key_file(folder + "/ca.crt", pem_of(*ca.value())); !ok) return ok;
  return write_key_file(folder + "/ca.crl", pem_of(*list.value()));
}

rt::Result<KeyLab> KeyLab::open(const std::string& folder) {
  KeyLab lab;
  lab.folder_ = folder;
  auto ca = drivers::read_certificate(folder + "/ca.crt");
  if (!ca) return rt::Error{ca.error() + " (teletact keys init makes a lab)"};
  lab.ca_ = std::move(ca).value();
  auto key = drivers::read_key(folder + "/ca.key");
  if (!key) return rt::Error{key.error()};
  lab.ca_key_ = std::move(key).value();
  if (X509_check_private_key(lab.ca_.get(), lab.ca_key_.get()) != 1)
    return rt::Error{folder + "/ca.key: not the key of ca.crt"};
  auto list = drivers::read_revoked(folder + "/ca.crl", *lab.ca_);
  if (!list) return rt::Error{list.error()};
  lab.list_ = std::move(list).value();
  return lab;
}

std::string KeyLab::box_folder(const std::string& name) const { return folder_ + "/boxes/" + name; }

std::int64_t KeyLab::ca_until_s() const {
  return drivers::seconds_of(X509_get0_notAfter(ca_.get()));
}

rt::Result<bool> KeyLab::certify(rt::Box role, const std::string& name, int days, EVP_PKEY& key,
                                 std::int64_t now_s) {
  const std::int64_t until = now_s + days * kDay_s;
  if (until > ca_until_s()) {
    return rt::Error{"--days " + std::to_string(days) + ": the CA itself expires on " +
                     drivers::day_of(ca_until_s())};
  }
  auto c = make_certificate({name, drivers::role_name(role), now_s - kBefore_s, until, false}, key,
                            ca_.get(), *ca_key_);
  if (!c) return rt::Error{c.error()};
  const std::string text = pem_of(*c.value());
  if (auto ok = write_key_file(folder_ + "/certificates/" + drivers::serial_of(*c.value()) + ".crt",
                               text);
      !ok)
    return ok;
  return replace_key_file(box_folder(name) + "/box.crt", text);
}

rt::Result<std::string> KeyLab::issue(rt::Box role, const std::string& name, int days,
                                      std::int64_t now_s) {
  if (auto ok = good_name(name); !ok) return rt::Error{ok.error()};
  if (auto ok = good_days(days); !ok) return rt::Error{ok.error()};
  const std::string box = box_folder(name);
  auto key = make_key();
  if (!key) return rt::Error{key.error()};
  if (auto ok = make_key_folder(box); !ok) return rt::Error{ok.error()};
  auto done = certify(role, name, days, *key.value(), now_s);
  if (done) done = write_key_file(box + "/box.key", pem_of(*key.value()));
  if (done) done = write_key_file(box + "/ca.crt", pem_of(*ca_));
  if (done) done = write_key_file(box + "/ca.crl", pem_of(*list_));
  if (done) return box;
  std::error_code ignored;
  fs::remove_all(box, ignored);
  return rt::Error{done.error()};
}

rt::Result<std::string> KeyLab::renew(const std::string& name, int days, bool new_key,
                                      std::int64_t now_s) {
  if (auto ok = good_name(name); !ok) return rt::Error{ok.error()};
  if (auto ok = good_days(days); !ok) return rt::Error{ok.error()};
  const std::string box = box_folder(name);
  auto old = drivers::read_certificate(box + "/box.crt");
  if (!old) return rt::Error{old.error()};
  const auto peer = drivers::read_peer(*old.value());
  if (!peer) return rt::Error{box + "/box.crt: " + peer.error()};
  // Who holds the key may be a thief: the name is not made good again by a new date.
  if (!new_key && drivers::is_revoked(*list_, *old.value()))
    return rt::Error{box + "/box.crt: is revoked; --new-key makes another key"};
  auto key = new_key ? make_key() : drivers::read_key(box + "/box.key");
  if (!key) return rt::Error{key.error()};
  if (auto ok = certify(peer.value().role, name, days, *key.value(), now_s); !ok)
    return rt::Error{ok.error()};
  if (new_key) {
    if (auto ok = replace_key_file(box + "/box.key", pem_of(*key.value())); !ok)
      return rt::Error{ok.error()};
  }
  return box;
}

rt::Result<std::vector<IssuedRow>> KeyLab::list() const {
  std::vector<IssuedRow> rows;
  std::error_code failed;
  for (const auto& file : fs::directory_iterator(folder_ + "/certificates", failed)) {
    auto c = drivers::read_certificate(file.path().string());
    if (!c) return rt::Error{c.error()};
    const auto peer = drivers::read_peer(*c.value());
    if (!peer) return rt::Error{file.path().string() + ": " + peer.error()};
    IssuedRow row;
    row.box = peer.value();
    row.from_s = drivers::seconds_of(X509_get0_notBefore(c.value().get()));
    row.revoked = drivers::is_revoked(*list_, *c.value());
    const auto now = drivers::read_certificate(box_folder(row.box.name) + "/box.crt");
    row.current = now && drivers::serial_of(*now.value()) == row.box.serial;
    rows.push_back(row);
  }
  if (failed) return rt::Error{folder_ + "/certificates: " + failed.message()};
  std::sort(rows.begin(), rows.end(), [](const IssuedRow& a, const IssuedRow& b) {
    return std::tie(a.box.name, a.from_s, a.box.serial) <
           std::tie(b.box.name, b.from_s, b.box.serial);
  });
  return rows;
}

rt::Result<int> KeyLab::revoke(const std::string& name, std::int64_t now_s) {
  if (auto ok = good_name(name); !ok) return rt::Error{ok.error()};
  const auto all = list();
  if (!all) return rt::Error{all.error()};
  std::vector<RevokedRow> revoked = rows_of(*list_);
  int known = 0, added = 0;
  for (const IssuedRow& row : all.value()) {
    if (row.box.name != name) continue;
    ++known;
    if (row.revoked) continue;
    ++added;
    revoked.push_back({row.box.serial, now_s});
  }
  if (known == 0) return rt::Error{"name '" + name + "': no certificate was issued for it"};
  if (added > 0) {
    auto made = make_revoked(*ca_, *ca_key_, revoked, drivers::revoked_number(*list_) + 1, now_s);
    if (!made) return rt::Error{made.error()};
    if (auto ok = replace_key_file(folder_ + "/ca.crl", pem_of(*made.value())); !ok)
      return rt::Error{ok.error()};
    list_ = std::move(made).value();
  }
  if (auto ok = hand_out_list(); !ok) return rt::Error{ok.error()};
  return added;
}

// To the folder of each box, also when nobody is revoked anew: a call before may have failed half
// way. One that can not be written keeps none of the others from it.
rt::Result<bool> KeyLab::hand_out_list() {
  const std::string text = pem_of(*list_);
  std::string failed;
  std::error_code error;
  for (const auto& box : fs::directory_iterator(folder_ + "/boxes", error)) {
    if (!box.is_directory(error)) continue;
    if (auto ok = replace_key_file(box.path().string() + "/ca.crl", text); !ok)
      failed += (failed.empty() ? "" : "; ") + ok.error();
  }
  if (!failed.empty()) return rt::Error{failed + "; revoke again when that is mended"};
  return true;
}

}  // namespace teletact

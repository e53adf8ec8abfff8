#include "tools/keys/web_lab.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <tuple>
#include <utility>

#include "tools/keys/certificate_maker.hpp"
#include "tools/keys/key_files.hpp"

namespace teletact {

namespace {

namespace fs = std::filesystem;
constexpr std::int64_t kDayWeb_s = 86400, kBeforeWeb_s = 3600;

std::string subject_of(X509& certificate, int field) {
  std::array<char, 128> text{};
  const int n = X509_NAME_get_text_by_NID(X509_get_subject_name(&certificate), field, text.data(),
                                          static_cast<int>(text.size()));
  return {text.data(), n > 0 ? static_cast<std::size_t>(n) : 0};
}

// DNS:a,IP:1.2.3.4; an error where one is neither.
rt::Result<std::string> alternative_of(const std::vector<std::string>& hosts) {
  std::string text;
  for (const std::string& host : hosts) {
    std::array<unsigned char, 16> ignored{};
    const bool numeric = inet_pton(AF_INET, host.c_str(), ignored.data()) == 1 ||
                         inet_pton(AF_INET6, host.c_str(), ignored.data()) == 1;
    const bool name =
        !host.empty() && host.size() <= 253 && host.front() != '-' &&
        std::all_of(host.begin(), host.end(), [](char c) {
          return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '.';
        });
    if (!numeric && !name)
      return rt::Error{"host '" + host + "': a name of a-z, 0-9, '-', '.', or a numeric address"};
    text += (text.empty() ? "" : ",") + std::string(numeric ? "IP:" : "DNS:") + host;
  }
  if (text.empty()) return rt::Error{"host: at least one is wanted"};
  return text;
}

rt::Result<bool> good_request(const std::string& name, int days) {
  if (!drivers::good_box_name(name))
    return rt::Error{"name '" + name +
                     "': allowed 1 to 40 letters, digits, '.', '_', '-', not '.' or '-' first"};
  if (days < 1 || days > WebLab::kMostDays)
    return rt::Error{"--days " + std::to_string(days) + ": allowed 1.." +
                     std::to_string(WebLab::kMostDays) + ", which is what browsers take"};
  return true;
}

}  // namespace

bool WebLab::is_there(const std::string& folder) { return fs::exists(folder + "/web/ca.crt"); }

rt::Result<bool> WebLab::make(const std::string& folder, std::int64_t now_s) {
  const auto lab = drivers::read_certificate(folder + "/ca.crt");
  if (!lab) return rt::Error{lab.error() + " (teletact keys init makes a lab)"};
  auto key = make_browser_key();
  if (!key) return rt::Error{key.error()};
  EVP_PKEY& k = *key.value();
  CertificateSpec spec;
  spec.name = subject_of(*lab.value(), NID_commonName) + " web";
  spec.unit = "lab web";
  spec.from_s = now_s - kBeforeWeb_s;
  spec.until_s = now_s + kDaysCa * kDayWeb_s;
  spec.ca = true;
  auto ca = make_certificate(spec, k, nullptr, k);
  if (!ca) return rt::Error{ca.error()};
  auto list = make_revoked(*ca.value(), k, {}, 1, now_s - kBeforeWeb_s);
  if (!list) return rt::Error{list.error()};
  const std::string at = folder + "/web";
  for (const std::string& part : {at, at + "/certificates", at + "/boxes", at + "/browsers"})
    if (auto ok = make_key_folder(part); !ok) return ok;
  if (auto ok = write_key_file(at + "/ca.key", pem_of(k)); !ok) return ok;
  if (auto ok = write_key_file(at + "/ca.crl", pem_of(*list.value())); !ok) return ok;
  return write_key_file(at + "/ca.crt", pem_of(*ca.value()));
}

rt::Result<WebLab> WebLab::open(const std::string& folder, std::int64_t now_s) {
  if (!is_there(folder))
    if (auto made = make(folder, now_s); !made) return rt::Error{made.error()};
  WebLab lab;
  lab.at_ = folder + "/web";
  auto ca = drivers::read_certificate(lab.at_ + "/ca.crt");
  if (!ca) return rt::Error{ca.error()};
  lab.ca_ = std::move(ca).value();
  auto key = drivers::read_key(lab.at_ + "/ca.key");
  if (!key) return rt::Error{key.error()};
  lab.ca_key_ = std::move(key).value();
  if (X509_check_private_key(lab.ca_.get(), lab.ca_key_.get()) != 1)
    return rt::Error{lab.at_ + "/ca.key: not the key of ca.crt"};
  auto list = drivers::read_revoked(lab.at_ + "/ca.crl", *lab.ca_);
  if (!list) return rt::Error{list.error()};
  lab.list_ = std::move(list).value();
  return lab;
}

rt::Result<drivers::CertificatePtr> WebLab::certify(const CertificateSpec& spec, EVP_PKEY& key) {
  auto c = make_certificate(spec, key, ca_.get(), *ca_key_);
  if (!c) return c;
  const std::string place = at_ + "/certificates/" + drivers::serial_of(*c.value()) + ".crt";
  if (auto ok = write_key_file(place, pem_of(*c.value())); !ok) return rt::Error{ok.error()};
  return c;
}

rt::Result<std::string> WebLab::issue_web(const std::string& name,
                                          const std::vector<std::string>& hosts, int days,
                                          std::int64_t now_s) {
  if (auto ok = good_request(name, days); !ok) return rt::Error{ok.error()};
  auto alternative = alternative_of(hosts);
  if (!alternative) return alternative;
  auto key = make_browser_key();
  if (!key) return rt::Error{key.error()};
  CertificateSpec spec{name,  "console",    now_s - kBeforeWeb_s, now_s + days * kDayWeb_s,
                       false, "serverAuth", alternative.value()};
  auto c = certify(spec, *key.value());
  if (!c) return rt::Error{c.error()};
  const std::string box = at_ + "/boxes/" + name;
  if (!fs::exists(box))
    if (auto ok = make_key_folder(box); !ok) return rt::Error{ok.error()};
  const std::pair<const char*, std::string> files[] = {{"/web.key", pem_of(*key.value())},
                                                       {"/web.crt", pem_of(*c.value())},
                                                       {"/ca.crt", pem_of(*ca_)},
                                                       {"/ca.crl", pem_of(*list_)}};
  for (const auto& [file, text] : files)
    if (auto ok = replace_key_file(box + file, text); !ok) return rt::Error{ok.error()};
  return box;
}

rt::Result<WebLab::Browser> WebLab::issue_browser(const std::string& name, int days,
                                                  std::int64_t now_s) {
  if (auto ok = good_request(name, days); !ok) return rt::Error{ok.error()};
  const std::string file = at_ + "/browsers/" + name + ".p12";
  if (fs::exists(file))
    return rt::Error{file +
                     ": is there already and is not overwritten: revoke it, or another name"};
  auto key = make_browser_key();
  if (!key) return rt::Error{key.error()};
  CertificateSpec spec{
      name, "browser", now_s - kBeforeWeb_s, now_s + days * kDayWeb_s, false, "clientAuth", {}};
  auto c = certify(spec, *key.value());
  if (!c) return rt::Error{c.error()};
  const std::string password = make_password();
  if (password.empty()) return rt::Error{"a password could not be made"};
  auto bytes = pkcs12_of(name, *key.value(), *c.value(), *ca_, password);
  if (!bytes) return rt::Error{bytes.error()};
  if (auto ok = write_key_file(file, bytes.value()); !ok) return rt::Error{ok.error()};
  return Browser{file, password};
}

rt::Result<std::vector<WebRow>> WebLab::list() const {
  std::vector<WebRow> rows;
  std::error_code failed;
  for (const auto& file : fs::directory_iterator(at_ + "/certificates", failed)) {
    auto c = drivers::read_certificate(file.path().string());
    if (!c) return rt::Error{c.error()};
    X509& x = *c.value();
    rows.push_back({subject_of(x, NID_commonName), subject_of(x, NID_organizationalUnitName),
                    drivers::serial_of(x), drivers::seconds_of(X509_get0_notAfter(&x)),
                    drivers::is_revoked(*list_, x)});
  }
  if (failed) return rt::Error{at_ + "/certificates: " + failed.message()};
  std::sort(rows.begin(), rows.end(), [](const WebRow& a, const WebRow& b) {
    return std::tie(a.unit, a.name, a.until_s, a.serial) <
           std::tie(b.unit, b.name, b.until_s, b.serial);
  });
  return rows;
}

rt::Result<int> WebLab::revoke(const std::string& name, std::int64_t now_s) {
  const auto all = list();
  if (!all) return rt::Error{all.error()};
  std::vector<RevokedRow> revoked = rows_of(*list_);
  int known = 0, added = 0;
  for (const WebRow& row : all.value()) {
    if (row.name != name) continue;
    ++known;
    if (row.revoked) continue;
    ++added;
    revoked.push_back({row.serial, now_s});
  }
  if (known == 0) return rt::Error{"name '" + name + "': no web certificate was issued for it"};
  std::error_code ignored;
  fs::remove(at_ + "/browsers/" + name + ".p12", ignored);
  if (added == 0) return 0;
  auto made = make_revoked(*ca_, *ca_key_, revoked, drivers::revoked_number(*list_) + 1, now_s);
  if (!made) return rt::Error{made.error()};
  const std::string text = pem_of(*made.value());
  if (auto ok = replace_key_file(at_ + "/ca.crl", text); !ok) return rt::Error{ok.error()};
  list_ = std::move(made).value();
  for (const auto& box : fs::directory_iterator(at_ + "/boxes", ignored))
    if (auto ok = replace_key_file(box.path().string() + "/ca.crl", text); !ok)
      return rt::Error{ok.error()};
  return added;
}

}  // namespace teletact

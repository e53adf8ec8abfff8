// The lab's second CA, for browsers: P-256, because browsers take no Ed25519. It vouches for the
// console's web servers and for the browsers that may reach them, and for nothing on the road.
//
//   web/ca.key ca.crt ca.crl     made at first use; ca.crt goes into the tablet as a trusted CA
//   web/certificates/SERIAL.crt  every certificate that was ever issued
//   web/boxes/NAME/              web.key web.crt ca.crt ca.crl: what goes to the box
// (operator.keys)
//   web/browsers/NAME.p12        what goes into the browser, behind a password that is told once
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/road/pem.hpp"
#include "rt/result.hpp"

namespace teletact {

struct WebRow {
  std::string name, unit, serial;  // unit: console or browser
  std::int64_t until_s = 0;
  bool revoked = false;
};

class WebLab {
 public:
  static constexpr int kDaysCa = 3650, kDaysWeb = 365, kMostDays = 800;
  // In the folder of a lab. Each error is one line.
  [[nodiscard]] static rt::Result<WebLab> open(const std::string& folder, std::int64_t now_s);
  [[nodiscard]] static bool is_there(const std::string& folder);

  // The folder for the box. `hosts`: names and numeric addresses by which browsers address it.
  // What is
  // there of that name is replaced, with a new key.
  [[nodiscard]] rt::Result<std::string> issue_web(const std::string& name,
                                                  const std::vector<std::string>& hosts, int days,
                                                  std::int64_t now_s);
  struct Browser {
    std::string file, password;
  };
  // Refused where browsers/NAME.p12 is there.
  [[nodiscard]] rt::Result<Browser> issue_browser(const std::string& name, int days,
                                                  std::int64_t now_s);
  // Every certificate of that name. How many were revoked that were not before.
  [[nodiscard]] rt::Result<int> revoke(const std::string& name, std::int64_t now_s);
  [[nodiscard]] rt::Result<std::vector<WebRow>> list() const;

 private:
  WebLab() = default;
  [[nodiscard]] static rt::Result<bool> make(const std::string& folder, std::int64_t now_s);
  [[nodiscard]] rt::Result<drivers::CertificatePtr> certify(const struct CertificateSpec& spec,
                                                            EVP_PKEY& key);
  std::string at_;
  drivers::CertificatePtr ca_;
  drivers::KeyPtr ca_key_;
  drivers::RevokedPtr list_;
};

}  // namespace teletact

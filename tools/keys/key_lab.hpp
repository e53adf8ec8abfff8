// The lab's CA as a folder, and the boxes it vouches for.
//
//   ca.key ca.crt ca.crl          the CA; ca.key stays on this machine, off line where possible
//   certificates/SERIAL.crt       every certificate that was ever issued
//   boxes/NAME/                   box.key box.crt ca.crt ca.crl: what goes to the box, as one
// folder
//
// Files are made with mode 0600 and folders with 0700; what is there is never overwritten but by
// renew (box.crt) and revoke (ca.crl), and those appear whole or not at all.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/road/pem.hpp"
#include "rt/result.hpp"
#include "rt/time.hpp"

namespace teletact {

struct IssuedRow {
  drivers::RoadPeer box;
  std::int64_t from_s = 0;
  bool revoked = false;
  bool current =
      false;  // the one in boxes/NAME; an older one is valid until it ends, or is revoked
};

class KeyLab {
 public:
  // Each: one line names the file, the value and what is allowed.
  [[nodiscard]] static rt::Result<bool> init(const std::string& folder, const std::string& name,
                                             int days, std::int64_t now_s);
  [[nodiscard]] static rt::Result<KeyLab> open(const std::string& folder);

  // The folder for the box.
  [[nodiscard]] rt::Result<std::string> issue(rt::Box role, const std::string& name, int days,
                                              std::int64_t now_s);
  // Another certificate for the same key, so that who has pinned it goes on; or for a new key.
  [[nodiscard]] rt::Result<std::string> renew(const std::string& name, int days, bool new_key,
                                              std::int64_t now_s);
  // Every certificate of that name. How many were revoked that were not before. The list goes to
  // each box's folder each time: after an error, again.
  [[nodiscard]] rt::Result<int> revoke(const std::string& name, std::int64_t now_s);
  [[nodiscard]] rt::Result<std::vector<IssuedRow>> list() const;
  [[nodiscard]] std::int64_t ca_until_s() const;

  static constexpr int kDaysCa = 3650, kDaysBox = 365, kMostDays = 7300;

 private:
  [[nodiscard]] rt::Result<bool> hand_out_list();
  KeyLab() = default;
  [[nodiscard]] rt::Result<bool> certify(rt::Box role, const std::string& name, int days,
                                         EVP_PKEY& key, std::int64_t now_s);
  [[nodiscard]] std::string box_folder(const std::string& name) const;

  std::string folder_;
  drivers::CertificatePtr ca_;
  drivers::KeyPtr ca_key_;
  drivers::RevokedPtr list_;
};

}  // namespace teletact

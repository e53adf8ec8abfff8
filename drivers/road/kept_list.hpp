// The newest list of revoked certificates that a box has used, kept over a restart. It bears the
// CA's signature, so whoever can write the folder can take it away but not make one up.
#pragma once

#include <string>

#include "drivers/road/pem.hpp"

namespace drivers {

class KeptList {
 public:
  KeptList() = default;  // none is kept
  // `folder` is made when it is needed. Empty: none is kept. Each CA has a file of its own there.
  KeptList(const std::string& folder, const X509& ca);

  // Null: nothing is kept. An error: what is kept is damaged or can not be read.
  [[nodiscard]] rt::Result<RevokedPtr> read(X509& ca) const;
  // In one step; an error leaves what was kept. Empty: it is kept.
  [[nodiscard]] std::string keep(const X509_CRL& list) const;
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  std::string folder_, path_;
};

}  // namespace drivers

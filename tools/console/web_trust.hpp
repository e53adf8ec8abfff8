// HTTPS off loopback: this box shows its certificate, and the browser must show one of the lab's
// web CA (`teletact keys web`, `teletact keys browser`). TLS 1.3 alone. Who has none, or a revoked
// one, gets no byte of the page. The list of revoked ones is read again when its file changes.
#pragma once

#include <openssl/ssl.h>
#include <sys/stat.h>

#include <memory>
#include <string>

#include "drivers/road/pem.hpp"
#include "rt/result.hpp"

namespace teletact {

// What a browser's certificate says; empty without TLS.
struct WebPeer {
  std::string name, serial;
};

class WebTrust {
 public:
  [[nodiscard]] static rt::Result<std::unique_ptr<WebTrust>> load(const std::string& folder);
  // The caller owns it; null where OpenSSL fails.
  [[nodiscard]] SSL_CTX* make_context() const;
  // True: another list is in use from now on. A damaged or older one changes nothing.
  [[nodiscard]] bool refresh();
  [[nodiscard]] bool revoked(const std::string& serial) const;
  [[nodiscard]] static WebPeer peer_of(SSL* session);

 private:
  WebTrust() = default;
  std::string folder_;
  drivers::CertificatePtr ca_, own_;
  drivers::KeyPtr key_;
  drivers::RevokedPtr list_;
  struct stat seen_ {};
};

}  // namespace teletact

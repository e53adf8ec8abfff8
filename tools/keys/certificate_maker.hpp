// Makes keys (Ed25519; P-256 for browsers, which take no other), certificates (X.509 v3) and
// signed lists of revoked ones (CRL v2). RFC
// 5280, RFC 8410. Nothing here knows of files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/road/pem.hpp"
#include "rt/result.hpp"

namespace teletact {

struct CertificateSpec {
  std::string name;                      // CN
  std::string unit;                      // OU: robot, operator; of a CA: lab
  std::int64_t from_s = 0, until_s = 0;  // valid, seconds since 1970
  bool ca = false;
  // Of no CA. Either box may dial, so each may be either end of TLS.
  std::string usage = "serverAuth,clientAuth";
  std::string alternative{};  // subjectAltName, as OpenSSL writes it: DNS:a,IP:1.2.3.4; empty: none
};

[[nodiscard]] rt::Result<drivers::KeyPtr> make_key();
[[nodiscard]] rt::Result<drivers::KeyPtr> make_browser_key();
// `issuer` null: signed by its own key.
[[nodiscard]] rt::Result<drivers::CertificatePtr> make_certificate(const CertificateSpec& spec,
                                                                   EVP_PKEY& key, X509* issuer,
                                                                   EVP_PKEY& issuer_key);

struct RevokedRow {
  std::string serial;  // hex
  std::int64_t at_s = 0;
};
[[nodiscard]] std::vector<RevokedRow> rows_of(X509_CRL& list);
[[nodiscard]] rt::Result<drivers::RevokedPtr> make_revoked(X509& ca, EVP_PKEY& ca_key,
                                                           const std::vector<RevokedRow>& rows,
                                                           std::int64_t number,
                                                           std::int64_t made_s);

// Key, certificate and CA in one file behind a password, as browsers and tablets take it in (PKCS
// 12,
// with 3DES and SHA-1: what all of them read; the password is made here and has 100 random bits).
[[nodiscard]] rt::Result<std::string> pkcs12_of(const std::string& name, EVP_PKEY& key,
                                                X509& certificate, X509& ca,
                                                const std::string& password);
[[nodiscard]] std::string make_password();

[[nodiscard]] std::string pem_of(const EVP_PKEY& key);
[[nodiscard]] std::string pem_of(const X509& certificate);
[[nodiscard]] std::string pem_of(const X509_CRL& list);

}  // namespace teletact

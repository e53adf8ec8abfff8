// Certificates, keys and lists of revoked certificates as files, and what they say. OpenSSL's
// objects with owners; every reader has a cap, and one line that names the file and what is wrong.
#pragma once

#include <openssl/evp.h>
#include <openssl/x509.h>

#include <cstdint>
#include <memory>
#include <string>

#include "drivers/road/road_options.hpp"
#include "rt/result.hpp"

namespace drivers {

struct PemFree {
  void operator()(X509* p) const noexcept { X509_free(p); }
  void operator()(X509_CRL* p) const noexcept { X509_CRL_free(p); }
  void operator()(EVP_PKEY* p) const noexcept { EVP_PKEY_free(p); }
};
using CertificatePtr = std::unique_ptr<X509, PemFree>;
using RevokedPtr = std::unique_ptr<X509_CRL, PemFree>;
using KeyPtr = std::unique_ptr<EVP_PKEY, PemFree>;

// Who may write a certificate, a list or their folder decides whom this box trusts: each is refused
// unless it is this user's or root's, and nobody else may write it. A folder that is not there is
// for who reads its files.
[[nodiscard]] rt::Result<bool> check_folder(const std::string& path);
[[nodiscard]] rt::Result<CertificatePtr> read_certificate(const std::string& path);
// Refused unless it belongs to this user and nobody else may read it.
[[nodiscard]] rt::Result<KeyPtr> read_key(const std::string& path);
// Refused unless the CA has signed it.
[[nodiscard]] rt::Result<RevokedPtr> read_revoked(const std::string& path, X509& ca);
// Of a CRL, its number: a list with a lower one is older.
[[nodiscard]] std::int64_t revoked_number(const X509_CRL& list);
[[nodiscard]] bool is_revoked(X509_CRL& list, X509& certificate);

// Subject: CN is the box's name (letters, digits, '.', '_', '-'; 1 to 40), OU its role.
[[nodiscard]] rt::Result<RoadPeer> read_peer(X509& certificate);
[[nodiscard]] bool good_box_name(const std::string& name) noexcept;
[[nodiscard]] const char* role_name(rt::Box role) noexcept;

[[nodiscard]] std::int64_t seconds_of(const ASN1_TIME* time);  // since 1970; 0: not a time
[[nodiscard]] std::string day_of(std::int64_t seconds);        // 2031-05-17, UTC
[[nodiscard]] std::string serial_of(const X509& certificate);  // hex
[[nodiscard]] std::string hex_of(const ASN1_INTEGER& number);
[[nodiscard]] std::string digest_of(const X509& certificate);  // SHA-256, hex
// Newest message of OpenSSL on this thread, which is then forgotten.
[[nodiscard]] std::string openssl_text();

}  // namespace drivers

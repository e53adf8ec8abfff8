#include "drivers/road/pem.hpp"

#include <fcntl.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/sha.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>

namespace drivers {

namespace {

constexpr std::size_t kMostFile = std::size_t{1} << 20U, kMostName = 40;

struct BioFree {
  void operator()(BIO* p) const noexcept { BIO_free(p); }
};
using BioPtr = std::unique_ptr<BIO, BioFree>;

// Nobody is asked for a password: a box starts without a person beside it.
int no_password(char*, int, int, void*) { return -1; }

constexpr const char* kNotOurs =
    "must belong to the user of this program or to root, and nobody else may write it (chmod go-w)";

bool only_ours(const struct stat& info) noexcept {
  return (info.st_mode & 022U) == 0 && (info.st_uid == ::geteuid() || info.st_uid == 0);
}

rt::Result<std::string> read_file(const std::string& path, bool secret) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return rt::Error{path + ": " + std::strerror(errno)};
  struct stat info {};
  std::string text, problem;
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
    problem = "not an ordinary file";
  } else if (secret && ((info.st_mode & 077U) != 0 || info.st_uid != ::geteuid())) {
    problem = "a key must belong to the user of this program and be of mode 0600 (chmod 600)";
  } else if (!secret && !only_ours(info)) {
    problem = kNotOurs;
  } else if (info.st_size > static_cast<off_t>(kMostFile)) {
    problem = "longer than 1 MiB";
  } else {
    text.resize(static_cast<std::size_t>(info.st_size));
    const ssize_t n = ::read(fd, text.data(), text.size());
    if (n != static_cast<ssize_t>(text.size())) problem = "can not be read";
  }
  ::close(fd);
  if (!problem.empty()) return rt::Error{path + ": " + problem};
  return text;
}

BioPtr view_of(const std::string& text) {
  return BioPtr(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

std::string hex(const std::uint8_t* bytes, std::size_t n) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (std::size_t i = 0; i < n; ++i) {
    text += kDigits[bytes[i] >> 4U];
    text += kDigits[bytes[i] & 15U];
  }
  return text;
}

// The only entry of the subject of that kind; empty: none, or more than one.
std::string entry(X509& certificate, int nid) {
  X509_NAME* subject = X509_get_subject_name(&certificate);
  const int at = X509_NAME_get_index_by_NID(subject, nid, -1);
  if (at < 0 || X509_NAME_get_index_by_NID(subject, nid, at) >= 0) return {};
  const ASN1_STRING* text = X509_NAME_ENTRY_get_data(X509_NAME_get_entry(subject, at));
  return {reinterpret_cast<const char*>(ASN1_STRING_get0_data(text)),
          static_cast<std::size_t>(ASN1_STRING_length(text))};
}

std::string key_sha256(X509& certificate) {
  std::uint8_t* der = nullptr;
  const int n = i2d_X509_PUBKEY(X509_get_X509_PUBKEY(&certificate), &der);
  if (n <= 0) return {};
  std::array<std::uint8_t, SHA256_DIGEST_LENGTH> digest{};
  SHA256(der, static_cast<std::size_t>(n), digest.data());
  OPENSSL_free(der);
  return hex(digest.data(), digest.size());
}

}  // namespace

std::string openssl_text() {
  const unsigned long code = ERR_peek_last_error();
  ERR_clear_error();
  const char* text = code == 0 ? nullptr : ERR_reason_error_string(code);
  return text == nullptr ? "no such thing in it" : text;
}

rt::Result<bool> check_folder(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0 || only_ours(info)) return true;
  return rt::Error{path + ": the folder of the keys " + kNotOurs};
}

rt::Result<CertificatePtr> read_certificate(const std::string& path) {
  const auto text = read_file(path, false);
  if (!text) return rt::Error{text.error()};
  const BioPtr bio = view_of(text.value());
  CertificatePtr c(PEM_read_bio_X509(bio.get(), nullptr, no_password, nullptr));
  if (!c) return rt::Error{path + ": not a certificate: " + openssl_text()};
  return c;
}

rt::Result<KeyPtr> read_key(const std::string& path) {
  auto text = read_file(path, true);
  if (!text) return rt::Error{text.error()};
  KeyPtr key;
  {
    const BioPtr bio = view_of(text.value());
    key.reset(PEM_read_bio_PrivateKey(bio.get(), nullptr, no_password, nullptr));
  }
  OPENSSL_cleanse(text.value().data(), text.value().size());
  if (!key) return rt::Error{path + ": not a private key without a password: " + openssl_text()};
  return key;
}

rt::Result<RevokedPtr> read_revoked(const std::string& path, X509& ca) {
  const auto text = read_file(path, false);
  if (!text) return rt::Error{text.error()};
  const BioPtr bio = view_of(text.value());
  RevokedPtr list(PEM_read_bio_X509_CRL(bio.get(), nullptr, no_password, nullptr));
  if (!list) return rt::Error{path + ": not a list of revoked certificates: " + openssl_text()};
  if (X509_CRL_verify(list.get(), X509_get0_pubkey(&ca)) != 1) {
    ERR_clear_error();
    return rt::Error{path + ": not signed by the CA of ca.crt"};
  }
  return list;
}

std::int64_t revoked_number(const X509_CRL& list) {
  auto* number =
      static_cast<ASN1_INTEGER*>(X509_CRL_get_ext_d2i(&list, NID_crl_number, nullptr, nullptr));
  std::int64_t value = 0;
  if (number == nullptr || ASN1_INTEGER_get_int64(&value, number) != 1) value = 0;
  ASN1_INTEGER_free(number);
  return value;
}

bool is_revoked(X509_CRL& list, X509& certificate) {
  X509_REVOKED* row = nullptr;
  return X509_CRL_get0_by_cert(&list, &row, &certificate) == 1;
}

bool good_box_name(const std::string& name) noexcept {
  if (name.empty() || name.size() > kMostName || name.front() == '.' || name.front() == '-')
    return false;
  for (const char c : name) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    const bool digit = c >= '0' && c <= '9';
    if (!letter && !digit && c != '.' && c != '_' && c != '-') return false;
  }
  return true;
}

const char* role_name(rt::Box role) noexcept {
  return role == rt::Box::kRobot ? "robot" : "operator";
}

rt::Result<RoadPeer> read_peer(X509& certificate) {
  RoadPeer peer;
  peer.name = entry(certificate, NID_commonName);
  if (!good_box_name(peer.name)) return rt::Error{"its certificate names no box"};
  const std::string role = entry(certificate, NID_organizationalUnitName);
  if (role == role_name(rt::Box::kRobot)) {
    peer.role = rt::Box::kRobot;
  } else if (role == role_name(rt::Box::kOperator)) {
    peer.role = rt::Box::kOperator;
  } else {
    return rt::Error{"its certificate says neither robot nor operator"};
  }
  peer.serial = serial_of(certificate);
  peer.key_sha256 = key_sha256(certificate);
  peer.valid_until_s = seconds_of(X509_get0_notAfter(&certificate));
  return peer;
}

std::int64_t seconds_of(const ASN1_TIME* time) {
  std::tm parts{};
  if (time == nullptr || ASN1_TIME_to_tm(time, &parts) != 1) return 0;
  return ::timegm(&parts);
}

std::string day_of(std::int64_t seconds) {
  const std::time_t t = seconds;
  std::tm parts{};
  std::array<char, 32> text{};
  if (::gmtime_r(&t, &parts) == nullptr) return "?";
  std::strftime(text.data(), text.size(), "%Y-%m-%d", &parts);
  return text.data();
}

std::string digest_of(const X509& certificate) {
  std::array<std::uint8_t, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  if (X509_digest(&certificate, EVP_sha256(), digest.data(), &size) != 1) return {};
  return hex(digest.data(), size);
}

std::string hex_of(const ASN1_INTEGER& number) {
  return hex(ASN1_STRING_get0_data(&number), static_cast<std::size_t>(ASN1_STRING_length(&number)));
}

std::string serial_of(const X509& certificate) {
  return hex_of(*X509_get0_serialNumber(&certificate));
}

}  // namespace drivers

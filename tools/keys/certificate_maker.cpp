#include "tools/keys/certificate_maker.hpp"

#include <openssl/bio.h>
#include <openssl/bn.h>
#include <openssl/pem.h>
#include <openssl/pkcs12.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>

#include <array>
#include <ctime>

namespace teletact {

namespace {

struct BioFree {
  void operator()(BIO* p) const noexcept { BIO_free(p); }
};
struct TimeFree {
  void operator()(ASN1_TIME* p) const noexcept { ASN1_TIME_free(p); }
};
using TimePtr = std::unique_ptr<ASN1_TIME, TimeFree>;

rt::Error failed(const char* what) {
  return rt::Error{std::string(what) + " could not be made: " + drivers::openssl_text()};
}

TimePtr time_of(std::int64_t seconds) { return TimePtr(ASN1_TIME_set(nullptr, seconds)); }

bool set_subject(X509& c, const CertificateSpec& spec) {
  X509_NAME* subject = X509_get_subject_name(&c);
  const auto add = [&](const char* field, const std::string& text) {
    return X509_NAME_add_entry_by_txt(subject, field, MBSTRING_UTF8,
                                      reinterpret_cast<const unsigned char*>(text.c_str()), -1, -1,
                                      0) == 1;
  };
  return add("O", "teletact") && add("OU", spec.unit) && add("CN", spec.name);
}

// 127 random bits: nobody can guess the next one, and none comes twice.
bool set_serial(X509& c) {
  std::array<unsigned char, 16> bytes{};
  if (RAND_bytes(bytes.data(), bytes.size()) != 1) return false;
  bytes[0] = static_cast<unsigned char>((bytes[0] & 0x7fU) | 0x40U);
  BIGNUM* number = BN_bin2bn(bytes.data(), bytes.size(), nullptr);
  const bool ok =
      number != nullptr && BN_to_ASN1_INTEGER(number, X509_get_serialNumber(&c)) != nullptr;
  BN_free(number);
  return ok;
}

bool add_extension(X509& c, X509* issuer, int nid, const char* value) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, issuer == nullptr ? &c : issuer, &c, nullptr, nullptr, 0);
  X509_EXTENSION* e = X509V3_EXT_conf_nid(nullptr, &context, nid, value);
  const bool ok = e != nullptr && X509_add_ext(&c, e, -1) == 1;
  X509_EXTENSION_free(e);
  return ok;
}

bool add_extensions(X509& c, X509* issuer, const CertificateSpec& spec) {
  const bool ca = spec.ca;
  bool ok = add_extension(c, issuer, NID_basic_constraints,
                          ca ? "critical,CA:TRUE,pathlen:0" : "critical,CA:FALSE");
  ok = ok && add_extension(c, issuer, NID_key_usage,
                           ca ? "critical,keyCertSign,cRLSign" : "critical,digitalSignature");
  if (!ca) ok = ok && add_extension(c, issuer, NID_ext_key_usage, spec.usage.c_str());
  if (!spec.alternative.empty())
    ok = ok && add_extension(c, issuer, NID_subject_alt_name, spec.alternative.c_str());
  ok = ok && add_extension(c, issuer, NID_subject_key_identifier, "hash");
  return ok && add_extension(c, issuer, NID_authority_key_identifier, "keyid:always");
}

// Ed25519 has its own.
const EVP_MD* digest_of(const EVP_PKEY& key) {
  return EVP_PKEY_get_base_id(&key) == EVP_PKEY_ED25519 ? nullptr : EVP_sha256();
}

template <class Write>
std::string pem_by(Write write) {
  const std::unique_ptr<BIO, BioFree> bio(BIO_new(BIO_s_mem()));
  if (!bio || write(bio.get()) != 1) return {};
  char* data = nullptr;
  const long n = BIO_get_mem_data(bio.get(), &data);
  return n > 0 ? std::string(data, static_cast<std::size_t>(n)) : std::string{};
}

bool add_row(X509_CRL& list, const RevokedRow& row) {
  BIGNUM* number = nullptr;
  ASN1_INTEGER* serial =
      BN_hex2bn(&number, row.serial.c_str()) > 0 ? BN_to_ASN1_INTEGER(number, nullptr) : nullptr;
  BN_free(number);
  X509_REVOKED* made = X509_REVOKED_new();
  const TimePtr at = time_of(row.at_s);
  const bool ok = serial != nullptr && made != nullptr && at &&
                  X509_REVOKED_set_serialNumber(made, serial) == 1 &&
                  X509_REVOKED_set_revocationDate(made, at.get()) == 1 &&
                  X509_CRL_add0_revoked(&list, made) == 1;
  ASN1_INTEGER_free(serial);
  if (!ok) X509_REVOKED_free(made);
  return ok;
}

bool number_list(X509_CRL& list, X509& ca, std::int64_t number) {
  ASN1_INTEGER* value = ASN1_INTEGER_new();
  bool ok = value != nullptr && ASN1_INTEGER_set_int64(value, number) == 1 &&
            X509_CRL_add1_ext_i2d(&list, NID_crl_number, value, 0, 0) == 1;
  ASN1_INTEGER_free(value);
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, &ca, nullptr, nullptr, &list, 0);
  X509_EXTENSION* e =
      X509V3_EXT_conf_nid(nullptr, &context, NID_authority_key_identifier, "keyid:always");
  ok = ok && e != nullptr && X509_CRL_add_ext(&list, e, -1) == 1;
  X509_EXTENSION_free(e);
  return ok;
}

}  // namespace

rt::Result<drivers::KeyPtr> make_key() {
  drivers::KeyPtr key(EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519"));
  if (!key) return failed("a key");
  return key;
}

rt::Result<drivers::KeyPtr> make_browser_key() {
  drivers::KeyPtr key(EVP_EC_gen("P-256"));
  if (!key) return failed("a key");
  return key;
}

rt::Result<drivers::CertificatePtr> make_certificate(const CertificateSpec& spec, EVP_PKEY& key,
                                                     X509* issuer, EVP_PKEY& issuer_key) {
  drivers::CertificatePtr c(X509_new());
  const TimePtr from = time_of(spec.from_s), until = time_of(spec.until_s);
  bool ok = c && from && until && X509_set_version(c.get(), X509_VERSION_3) == 1;
  ok = ok && set_serial(*c) && set_subject(*c, spec);
  ok = ok && X509_set_issuer_name(c.get(), X509_get_subject_name(issuer ? issuer : c.get())) == 1;
  ok = ok && X509_set1_notBefore(c.get(), from.get()) == 1;
  ok = ok && X509_set1_notAfter(c.get(), until.get()) == 1;
  ok = ok && X509_set_pubkey(c.get(), &key) == 1;
  ok = ok && add_extensions(*c, issuer, spec);
  ok = ok && X509_sign(c.get(), &issuer_key, digest_of(issuer_key)) > 0;
  if (!ok) return failed("a certificate");
  return c;
}

std::vector<RevokedRow> rows_of(X509_CRL& list) {
  std::vector<RevokedRow> rows;
  STACK_OF(X509_REVOKED)* all = X509_CRL_get_REVOKED(&list);
  for (int i = 0; i < sk_X509_REVOKED_num(all); ++i) {
    const X509_REVOKED* r = sk_X509_REVOKED_value(all, i);
    rows.push_back({drivers::hex_of(*X509_REVOKED_get0_serialNumber(r)),
                    drivers::seconds_of(X509_REVOKED_get0_revocationDate(r))});
  }
  return rows;
}

rt::Result<drivers::RevokedPtr> make_revoked(X509& ca, EVP_PKEY& ca_key,
                                             const std::vector<RevokedRow>& rows,
                                             std::int64_t number, std::int64_t made_s) {
  drivers::RevokedPtr list(X509_CRL_new());
  const TimePtr made = time_of(made_s);
  bool ok = list && made && X509_CRL_set_version(list.get(), X509_CRL_VERSION_2) == 1;
  ok = ok && X509_CRL_set_issuer_name(list.get(), X509_get_subject_name(&ca)) == 1;
  ok = ok && X509_CRL_set1_lastUpdate(list.get(), made.get()) == 1;
  // It holds until a newer one comes: a robot that hears of none for months must still drive.
  ok = ok && X509_CRL_set1_nextUpdate(list.get(), X509_get0_notAfter(&ca)) == 1;
  for (const RevokedRow& row : rows) ok = ok && add_row(*list, row);
  ok = ok && number_list(*list, ca, number);
  ok = ok && X509_CRL_sort(list.get()) == 1 &&
       X509_CRL_sign(list.get(), &ca_key, digest_of(ca_key)) > 0;
  if (!ok) return failed("a list of revoked certificates");
  return list;
}

rt::Result<std::string> pkcs12_of(const std::string& name, EVP_PKEY& key, X509& certificate,
                                  X509& ca, const std::string& password) {
  STACK_OF(X509)* others = sk_X509_new_null();
  PKCS12* file = nullptr;
  constexpr int kKind = NID_pbe_WithSHA1And3_Key_TripleDES_CBC, kRounds = 20000;
  if (others != nullptr && sk_X509_push(others, &ca) > 0)
    file = PKCS12_create(password.c_str(), name.c_str(), &key, &certificate, others, kKind, kKind,
                         kRounds, -1, 0);
  sk_X509_free(others);
  const bool ok = file != nullptr &&
                  PKCS12_set_mac(file, password.c_str(), -1, nullptr, 0, kRounds, EVP_sha1()) == 1;
  unsigned char* der = nullptr;
  const int n = ok ? i2d_PKCS12(file, &der) : -1;
  PKCS12_free(file);
  if (n <= 0) return failed("a file for a browser");
  std::string bytes(reinterpret_cast<const char*>(der), static_cast<std::size_t>(n));
  OPENSSL_free(der);
  return bytes;
}

std::string make_password() {
  // 32 signs that nobody takes for one another.
  static constexpr char kSigns[] = "abcdefghijkmnpqrstuvwxyz23456789";
  std::array<unsigned char, 20> bytes{};
  std::string text;
  if (RAND_bytes(bytes.data(), bytes.size()) != 1) return text;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (i > 0 && i % 5 == 0) text += '-';
    text += kSigns[bytes[i] & 31U];
  }
  return text;
}

std::string pem_of(const EVP_PKEY& key) {
  return pem_by([&](BIO* b) {
    return PEM_write_bio_PrivateKey(b, &key, nullptr, nullptr, 0, nullptr, nullptr);
  });
}
std::string pem_of(const X509& certificate) {
  return pem_by([&](BIO* b) { return PEM_write_bio_X509(b, &certificate); });
}
std::string pem_of(const X509_CRL& list) {
  return pem_by([&](BIO* b) { return PEM_write_bio_X509_CRL(b, &list); });
}

}  // namespace teletact

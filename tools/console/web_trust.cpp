#include "tools/console/web_trust.hpp"

#include <openssl/bn.h>
#include <openssl/err.h>

#include <array>
#include <ctime>

namespace teletact {

namespace {

bool same_list(const struct stat& a, const struct stat& b) noexcept {
  return a.st_ino == b.st_ino && a.st_dev == b.st_dev && a.st_size == b.st_size &&
         a.st_mtim.tv_sec == b.st_mtim.tv_sec && a.st_mtim.tv_nsec == b.st_mtim.tv_nsec;
}

std::string common_name(X509& certificate) {
  std::array<char, 64> text{};
  const int n = X509_NAME_get_text_by_NID(X509_get_subject_name(&certificate), NID_commonName,
                                          text.data(), static_cast<int>(text.size()));
  std::string name(text.data(), n > 0 ? static_cast<std::size_t>(n) : 0);
  return drivers::good_box_name(name) ? name : std::string{};
}

}  // namespace

rt::Result<std::unique_ptr<WebTrust>> WebTrust::load(const std::string& folder) {
  std::unique_ptr<WebTrust> t(new WebTrust);
  t->folder_ = folder;
  auto ca = drivers::read_certificate(folder + "/ca.crt");
  if (!ca) return rt::Error{ca.error()};
  t->ca_ = std::move(ca).value();
  auto own = drivers::read_certificate(folder + "/web.crt");
  if (!own) return rt::Error{own.error() + " (teletact keys web makes it)"};
  t->own_ = std::move(own).value();
  auto key = drivers::read_key(folder + "/web.key");
  if (!key) return rt::Error{key.error()};
  t->key_ = std::move(key).value();
  const std::string list = folder + "/ca.crl";
  ::stat(list.c_str(), &t->seen_);
  auto revoked = drivers::read_revoked(list, *t->ca_);
  if (!revoked) return rt::Error{revoked.error()};
  t->list_ = std::move(revoked).value();
  ERR_clear_error();
  const std::string place = folder + "/web.crt: ";
  if (X509_check_private_key(t->own_.get(), t->key_.get()) != 1)
    return rt::Error{place + "web.key is not the key of this certificate"};
  if (X509_verify(t->own_.get(), X509_get0_pubkey(t->ca_.get())) != 1)
    return rt::Error{place + "not signed by the CA of ca.crt"};
  const std::int64_t until_s = drivers::seconds_of(X509_get0_notAfter(t->own_.get()));
  if (until_s < std::time(nullptr))
    return rt::Error{place + "expired on " + drivers::day_of(until_s) + ": teletact keys web"};
  return t;
}

SSL_CTX* WebTrust::make_context() const {
  SSL_CTX* c = SSL_CTX_new(TLS_server_method());
  if (c == nullptr) return nullptr;
  X509_STORE* store = SSL_CTX_get_cert_store(c);
  bool ok = SSL_CTX_set_min_proto_version(c, TLS1_3_VERSION) == 1;
  ok = ok && SSL_CTX_use_certificate(c, own_.get()) == 1;
  ok = ok && SSL_CTX_use_PrivateKey(c, key_.get()) == 1;
  ok = ok && X509_STORE_add_cert(store, ca_.get()) == 1;
  ok = ok && X509_STORE_add_crl(store, list_.get()) == 1;
  ok = ok && X509_STORE_set_flags(store, X509_V_FLAG_CRL_CHECK) == 1;
  // A browser with several certificates offers the one that fits.
  ok = ok && SSL_CTX_add_client_CA(c, ca_.get()) == 1;
  ok = ok && SSL_CTX_set_num_tickets(c, 0) == 1;
  SSL_CTX_set_options(c, SSL_OP_NO_TICKET | SSL_OP_NO_RENEGOTIATION);
  SSL_CTX_set_session_cache_mode(c, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_mode(c, SSL_MODE_RELEASE_BUFFERS);
  SSL_CTX_set_verify_depth(c, 0);  // no CA between this one and a browser
  SSL_CTX_set_verify(c, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, nullptr);
  if (ok) return c;
  SSL_CTX_free(c);
  return nullptr;
}

bool WebTrust::refresh() {
  const std::string path = folder_ + "/ca.crl";
  struct stat now {};
  if (::stat(path.c_str(), &now) != 0 || same_list(now, seen_)) return false;
  seen_ = now;
  auto read = drivers::read_revoked(path, *ca_);
  if (!read || drivers::revoked_number(*read.value()) < drivers::revoked_number(*list_))
    return false;
  list_ = std::move(read).value();
  return true;
}

bool WebTrust::revoked(const std::string& serial) const {
  BIGNUM* number = nullptr;
  if (serial.empty() || BN_hex2bn(&number, serial.c_str()) == 0) return false;
  ASN1_INTEGER* as_integer = BN_to_ASN1_INTEGER(number, nullptr);
  X509_REVOKED* row = nullptr;
  const bool found = X509_CRL_get0_by_serial(list_.get(), &row, as_integer) == 1;
  ASN1_INTEGER_free(as_integer);
  BN_free(number);
  return found;
}

WebPeer WebTrust::peer_of(SSL* session) {
  const drivers::CertificatePtr c(SSL_get1_peer_certificate(session));
  if (!c) return {};
  return {common_name(*c), drivers::serial_of(*c)};
}

}  // namespace teletact

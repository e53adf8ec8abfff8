#include "drivers/road/trust.hpp"

#include <openssl/err.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <cstring>
#include <ctime>
#include <utility>

namespace drivers {

namespace {

#ifndef TELETACT_BUILD_DAY
#define TELETACT_BUILD_DAY 20000
#endif
constexpr std::int64_t kDay_s = 86400, kBuilt_s = TELETACT_BUILD_DAY * kDay_s;
constexpr std::int64_t kNearEnd_s = 14 * kDay_s;
// Chunks that hold up another connection's bytes for 8 ms at most on 10 Mbit/s.
constexpr long kFragment = 8192;
// Bytes of a peer's chain of certificates. A box shows its own and the lab's CA: under 1 kB.
constexpr long kMostChain = 4096;

bool same_file(const struct stat& a, const struct stat& b) noexcept {
  return a.st_ino == b.st_ino && a.st_dev == b.st_dev && a.st_size == b.st_size &&
         a.st_mtim.tv_sec == b.st_mtim.tv_sec && a.st_mtim.tv_nsec == b.st_mtim.tv_nsec;
}

}  // namespace

rt::Result<std::unique_ptr<RoadTrust>> RoadTrust::load(const RoadOptions& options) {
  std::unique_ptr<RoadTrust> t(new RoadTrust);
  t->folder_ = options.keys;
  t->expected_ = options.expected_peer;
  t->role_ = options.role;
  t->wall_s_ = options.wall_clock_s ? options.wall_clock_s
                                    : [] { return static_cast<std::int64_t>(std::time(nullptr)); };
  if (const auto folder = check_folder(t->folder_); !folder) return rt::Error{folder.error()};
  auto ca = read_certificate(t->folder_ + "/ca.crt");
  if (!ca) return rt::Error{ca.error()};
  t->ca_ = std::move(ca).value();
  t->look_at_own();
  auto own = t->read_own();
  if (!own) return rt::Error{own.error()};
  const std::string list = t->folder_ + "/ca.crl";
  ::stat(list.c_str(), &t->seen_);
  auto revoked = read_revoked(list, *t->ca_);
  if (!revoked) return rt::Error{revoked.error()};
  t->list_ = std::move(revoked).value();
  t->take_kept(options.state);
  const std::int64_t begins_s = seconds_of(X509_get0_notBefore(own.value().certificate.get()));
  t->earliest_s_ = std::max(kBuilt_s, begins_s);
  // By a clock that is unset, a list made after the end of the box's own certificate says that this
  // one has expired; a clock that is set knows better.
  if (t->wall_s_() < t->earliest_s_) t->earliest_s_ = std::max(t->earliest_s_, t->list_date_s());
  if (const std::string problem = t->take_own(std::move(own).value()); !problem.empty())
    return rt::Error{problem};
  t->take_date();
  return t;
}

// Of before this start: a list that is older than it changes nothing now either.
void RoadTrust::take_kept(const std::string& folder) {
  kept_ = KeptList(folder, *ca_);
  auto kept = kept_.read(*ca_);
  if (!kept) {
    keep_list();
    if (kept_problem_.empty())
      kept_problem_ = kept.error() + "; a list that is older than it is not known as such";
    return;
  }
  if (kept.value()) {
    const std::int64_t before = revoked_number(*kept.value()), now = revoked_number(*list_);
    if (before == now) return;
    if (before > now) {
      list_problem_ = folder_ +
                      "/ca.crl: older than the list that this box has used, which stays; " +
                      "if the CA began anew, remove " + kept_.path();
      list_ = std::move(kept).value();
      return;
    }
  }
  keep_list();
}

void RoadTrust::keep_list() {
  kept_problem_ = kept_.keep(*list_);
  if (!kept_problem_.empty()) kept_problem_ += ": the list is not kept over a restart";
}

void RoadTrust::look_at_own() {
  ::stat((folder_ + "/box.crt").c_str(), &seen_own_);
  ::stat((folder_ + "/box.key").c_str(), &seen_key_);
}

rt::Result<RoadTrust::Own> RoadTrust::read_own() const {
  Own own;
  auto certificate = read_certificate(folder_ + "/box.crt");
  if (!certificate) return rt::Error{certificate.error()};
  own.certificate = std::move(certificate).value();
  auto key = read_key(folder_ + "/box.key");
  if (!key) return rt::Error{key.error()};
  own.key = std::move(key).value();
  const auto self = read_peer(*own.certificate);
  if (!self) return rt::Error{folder_ + "/box.crt: " + self.error()};
  own.self = self.value();
  return own;
}

// Empty: it is in use now.
std::string RoadTrust::take_own(Own own) {
  const std::int64_t begins_s = seconds_of(X509_get0_notBefore(own.certificate.get()));
  const std::int64_t before_s = std::exchange(earliest_s_, std::max(earliest_s_, begins_s));
  const std::string problem = check_self(own);
  if (problem.empty()) {
    own_ = std::move(own);
    return {};
  }
  earliest_s_ = before_s;
  return folder_ + "/box.crt: " + problem;
}

std::string RoadTrust::check_self(const Own& own) const {
  ERR_clear_error();
  if (X509_check_private_key(own.certificate.get(), own.key.get()) != 1)
    return "box.key is not the key of this certificate";
  if (X509_verify(own.certificate.get(), X509_get0_pubkey(ca_.get())) != 1)
    return "not signed by the CA of ca.crt";
  if (own.self.role != role_) {
    return std::string("it is the certificate of a") +
           (own.self.role == rt::Box::kOperator ? "n operator" : " robot") + ", this box is the " +
           role_name(role_);
  }
  if (own.self.valid_until_s < judged_at_s()) {
    return "expired on " + day_of(own.self.valid_until_s) + " (it is taken to be " +
           day_of(judged_at_s()) + "): teletact keys renew";
  }
  if (is_revoked(*list_, *own.certificate))
    return "revoked: teletact keys renew NAME --new-key makes another one";
  return {};
}

std::int64_t RoadTrust::list_date_s() const {
  return seconds_of(X509_CRL_get0_lastUpdate(list_.get()));
}

// Of the list. A date beyond the box's own certificate would shut out everybody, this box too: what
// the list revokes counts, its date does not.
void RoadTrust::take_date() {
  date_problem_.clear();
  if (list_date_s() <= own_.self.valid_until_s) {
    earliest_s_ = std::max(earliest_s_, list_date_s());
    return;
  }
  date_problem_ = folder_ + "/ca.crl: dated " + day_of(list_date_s()) +
                  ", after the end of this box's certificate (" + day_of(own_.self.valid_until_s) +
                  "): what it revokes counts, its date does not; is the clock of the CA's machine "
                  "ahead?";
}

std::int64_t RoadTrust::judged_at_s() const { return std::max(wall_s_(), earliest_s_); }

std::string RoadTrust::note() const {
  std::string all;
  const auto add = [&all](const std::string& one) { all += (all.empty() ? "" : "; ") + one; };
  if (!list_problem_.empty()) add(list_problem_);
  if (!kept_problem_.empty()) add(kept_problem_);
  if (!date_problem_.empty()) add(date_problem_);
  if (!own_problem_.empty()) add(own_problem_);
  if (wall_s_() < earliest_s_) {
    add("this box's clock says " + day_of(wall_s_()) + ", which is before " + day_of(earliest_s_) +
        ": certificates are judged as of " + day_of(earliest_s_));
  }
  if (own_.self.valid_until_s - judged_at_s() < kNearEnd_s) {
    add("this box's certificate expires on " + day_of(own_.self.valid_until_s) +
        ": teletact keys renew " + own_.self.name);
  }
  return all;
}

ssl_ctx_st* RoadTrust::make_context() const {
  SSL_CTX* c = SSL_CTX_new(TLS_method());
  if (c == nullptr) return nullptr;
  X509_STORE* store = SSL_CTX_get_cert_store(c);
  bool ok = SSL_CTX_set_min_proto_version(c, TLS1_3_VERSION) == 1;
  ok = ok && SSL_CTX_set_max_proto_version(c, TLS1_3_VERSION) == 1;
  ok = ok && SSL_CTX_use_certificate(c, own_.certificate.get()) == 1;
  ok = ok && SSL_CTX_use_PrivateKey(c, own_.key.get()) == 1;
  ok = ok && X509_STORE_add_cert(store, ca_.get()) == 1;
  ok = ok && X509_STORE_add_crl(store, list_.get()) == 1;
  ok = ok && X509_STORE_set_flags(store, X509_V_FLAG_CRL_CHECK | X509_V_FLAG_X509_STRICT) == 1;
  ok = ok && SSL_CTX_set1_groups_list(c, "X25519:P-256") == 1;
  ok = ok && SSL_CTX_set_num_tickets(c, 0) == 1;
  ok = ok && SSL_CTX_set_max_send_fragment(c, kFragment) == 1;
  SSL_CTX_set_options(c, SSL_OP_NO_TICKET | SSL_OP_NO_RENEGOTIATION);
  SSL_CTX_set_session_cache_mode(c, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_mode(c, SSL_MODE_RELEASE_BUFFERS);
  SSL_CTX_set_max_cert_list(c, kMostChain);
  SSL_CTX_set_verify_depth(c, 0);  // no CA between this one and a box
  // Also where a connection should forget to ask for it.
  SSL_CTX_set_verify(c, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, nullptr);
  if (ok) return c;
  SSL_CTX_free(c);
  return nullptr;
}

std::string RoadTrust::text_of(int error, X509* certificate) const {
  const std::string taken = " (it is taken to be " + day_of(judged_at_s()) + ")";
  switch (error) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return "its certificate expired on " + day_of(seconds_of(X509_get0_notAfter(certificate))) +
             taken;
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return "its certificate is not valid before " +
             day_of(seconds_of(X509_get0_notBefore(certificate))) + taken;
    case X509_V_ERR_CERT_REVOKED:
      return "its certificate " + serial_of(*certificate) + " is revoked";
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
      return "its certificate is signed by itself, not by this lab's CA";
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
    case X509_V_ERR_CERT_SIGNATURE_FAILURE:
    case X509_V_ERR_CERT_CHAIN_TOO_LONG:
      return "its certificate is not signed by this lab's CA";
    default:
      return std::string("its certificate is no good: ") + X509_verify_cert_error_string(error);
  }
}

std::string RoadTrust::judge_box(x509_store_ctx_st* chain, RoadPeer& peer) const {
  X509* certificate = X509_STORE_CTX_get_current_cert(chain);
  const auto said = read_peer(*certificate);
  if (!said) return said.error();
  const RoadPeer& p = said.value();
  if (p.role == role_) {
    return std::string("its certificate is of the role ") + role_name(p.role) +
           ", and so is this box";
  }
  const bool by_key = expected_.starts_with("sha256:");
  if (!expected_.empty() && expected_ != (by_key ? "sha256:" + p.key_sha256 : p.name)) {
    return "it is '" + p.name + "' (sha256:" + p.key_sha256 + "), expected is " + expected_;
  }
  // A list that is newer than the context of this handshake counts too.
  if (is_revoked(*list_, *certificate)) return text_of(X509_V_ERR_CERT_REVOKED, certificate);
  peer = p;
  return {};
}

// A list that is dated ahead is told by take_date(). By a clock that is behind nothing can be said
// not to be valid yet: the certificate may be newer than all that this box knows.
bool RoadTrust::excused(int error) const {
  return error == X509_V_ERR_CRL_NOT_YET_VALID ||
         (error == X509_V_ERR_CERT_NOT_YET_VALID && wall_s_() < earliest_s_);
}

bool RoadTrust::judge(bool good_so_far, x509_store_ctx_st* chain, RoadPeer& peer,
                      std::string& why) const {
  const int depth = X509_STORE_CTX_get_error_depth(chain);
  if (!good_so_far && excused(X509_STORE_CTX_get_error(chain))) {
    X509_STORE_CTX_set_error(chain, X509_V_OK);
    return true;
  }
  if (!good_so_far) {
    why = text_of(X509_STORE_CTX_get_error(chain), X509_STORE_CTX_get_current_cert(chain));
    if (depth > 0) why = "its CA: " + why;
    return false;
  }
  if (depth > 0) return true;
  why = judge_box(chain, peer);
  if (why.empty()) return true;
  X509_STORE_CTX_set_error(chain, X509_V_ERR_APPLICATION_VERIFICATION);
  return false;
}

bool RoadTrust::revoked(const std::string& serial) const {
  BIGNUM* number = nullptr;
  if (BN_hex2bn(&number, serial.c_str()) == 0) return false;
  ASN1_INTEGER* as_integer = BN_to_ASN1_INTEGER(number, nullptr);
  X509_REVOKED* row = nullptr;
  const bool found = X509_CRL_get0_by_serial(list_.get(), &row, as_integer) == 1;
  ASN1_INTEGER_free(as_integer);
  BN_free(number);
  return found;
}

bool RoadTrust::refresh() {
  const bool list = refresh_list(), own = refresh_own();
  if (list || own) take_date();
  return list || own;
}

// Both files are put there one after the other: what does not fit together is looked at again when
// either changes.
bool RoadTrust::refresh_own() {
  const struct stat certificate = seen_own_, key = seen_key_;
  look_at_own();
  if (same_file(certificate, seen_own_) && same_file(key, seen_key_)) return false;
  auto own = read_own();
  own_problem_ = own ? take_own(std::move(own).value()) : own.error();
  if (own_problem_.empty()) return true;
  own_problem_ += "; the certificate of before stays in use";
  return false;
}

bool RoadTrust::refresh_list() {
  const std::string path = folder_ + "/ca.crl";
  struct stat now {};
  if (::stat(path.c_str(), &now) != 0) {
    list_problem_ = path + ": is gone; the list of before stays in use";
    seen_ = {};
    return false;
  }
  if (same_file(now, seen_)) return false;
  seen_ = now;
  auto read = read_revoked(path, *ca_);
  if (!read) {
    list_problem_ = read.error() + "; the list of before stays in use";
    return false;
  }
  if (revoked_number(*read.value()) < revoked_number(*list_)) {
    list_problem_ = path + ": older than the list in use, which stays";
    return false;
  }
  list_problem_.clear();
  list_ = std::move(read).value();
  keep_list();
  return true;
}

}  // namespace drivers

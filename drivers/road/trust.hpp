// Who a box trusts: the CA of its key folder, and nobody else. Certificates are judged in the TLS
// handshake, both ways, so no byte of a stranger gets past it.
//
// A peer is let in when its certificate: is signed by this CA itself (no intermediate); is valid
// now; is not in the CA's list of revoked ones; names a box of the other role; is that of
// `expected_peer`, where one is set.
//
// "Now" is the box's clock, but never before: the day this program was built, the beginning of this
// box's own certificate, the date of the list of revoked ones. A robot whose clock is unset (1970
// after each power-up) is thus judged by the newest of these, and can not be made to take a
// certificate that had expired by then; one that begins later it takes. A clock that is ahead
// refuses good certificates, and the reason names the date it took. A list's date that is after the
// end of this box's own certificate is told, and does not count; what that list revokes does.
//
// The list is looked at again every reread_period. A list that is damaged, of another CA or older
// than the one in use changes nothing, and note() says so; with a state folder, none that is older
// than one that was in use before this start either. So are the box's own certificate and
// key: renewed ones are shown from the next handshake on; what check_self() refuses changes
// nothing, and is told likewise.
#pragma once

#include <sys/stat.h>

#include <functional>
#include <memory>
#include <string>

#include "drivers/road/kept_list.hpp"
#include "drivers/road/pem.hpp"
#include "drivers/road/road_options.hpp"
#include "rt/result.hpp"

struct ssl_ctx_st;
struct x509_store_ctx_st;

namespace drivers {

class RoadTrust {
 public:
  [[nodiscard]] static rt::Result<std::unique_ptr<RoadTrust>> load(const RoadOptions& options);

  // TLS 1.3 only, both certificates, no tickets, no resumption. The caller owns it.
  [[nodiscard]] ssl_ctx_st* make_context() const;
  // OpenSSL's verdict on a certificate of the chain, and then ours. False: refused, `why` says it.
  // True for the box's own certificate (depth 0): `peer` is filled in.
  [[nodiscard]] bool judge(bool good_so_far, x509_store_ctx_st* chain, RoadPeer& peer,
                           std::string& why) const;
  // The instant by which certificates are judged, seconds since 1970.
  [[nodiscard]] std::int64_t judged_at_s() const;

  // Reads again what has changed of the files. True: another list or certificate is in use from now
  // on.
  [[nodiscard]] bool refresh();
  [[nodiscard]] bool revoked(const std::string& serial) const;

  [[nodiscard]] const RoadPeer& self() const noexcept { return own_.self; }
  // What a person should know: the clock is unset, the list can not be read, the end is near.
  [[nodiscard]] std::string note() const;

 private:
  RoadTrust() = default;
  struct Own {
    CertificatePtr certificate;
    KeyPtr key;
    RoadPeer self;
  };
  void take_kept(const std::string& folder);
  void keep_list();
  void look_at_own();
  [[nodiscard]] rt::Result<Own> read_own() const;
  [[nodiscard]] std::string take_own(Own own);
  [[nodiscard]] std::int64_t list_date_s() const;
  void take_date();
  [[nodiscard]] bool refresh_list();
  [[nodiscard]] bool refresh_own();
  [[nodiscard]] std::string check_self(const Own& own) const;
  [[nodiscard]] std::string judge_box(x509_store_ctx_st* chain, RoadPeer& peer) const;
  [[nodiscard]] bool excused(int error) const;
  [[nodiscard]] std::string text_of(int error, X509* certificate) const;

  std::string folder_, expected_;
  rt::Box role_ = rt::Box::kRobot;
  std::function<std::int64_t()> wall_s_;
  CertificatePtr ca_;
  Own own_;
  RevokedPtr list_;
  KeptList kept_;
  std::int64_t earliest_s_ = 0;
  // Of the files of the list, the certificate and the key.
  struct stat seen_ {
  }, seen_own_{}, seen_key_{};
  std::string list_problem_, kept_problem_, own_problem_, date_problem_;
};

}  // namespace drivers

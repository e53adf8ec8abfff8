#include "drivers/road/road_connection.hpp"

#include <openssl/err.h>
#include <openssl/ssl.h>

#include <algorithm>

namespace drivers {

namespace {

namespace asio = boost::asio;

constexpr std::size_t kInbox = 16384, kChunk = 8192;

// What an alert of the other side means for a person. Null: nothing of ours.
const char* alert_text(int reason) {
  switch (reason) {
    case SSL_R_SSLV3_ALERT_CERTIFICATE_EXPIRED:
      return "the other side says that this box's certificate has expired";
    case SSL_R_SSLV3_ALERT_CERTIFICATE_REVOKED:
      return "the other side says that this box's certificate is revoked";
    case SSL_R_TLSV1_ALERT_UNKNOWN_CA:
      return "the other side knows another CA than that of this box's certificate";
    case SSL_R_SSLV3_ALERT_BAD_CERTIFICATE:
      return "the other side does not take this box's certificate (not valid yet, or damaged)";
    case SSL_R_TLSV13_ALERT_CERTIFICATE_REQUIRED:
      return "the other side wants a certificate";
    case SSL_R_SSLV3_ALERT_HANDSHAKE_FAILURE:
      return "the other side does not take this box: another role or name than it expects";
    case SSL_R_PEER_DID_NOT_RETURN_A_CERTIFICATE:
      return "it shows no certificate";
    case SSL_R_UNSUPPORTED_PROTOCOL:
    case SSL_R_TLSV1_ALERT_PROTOCOL_VERSION:
      return "it does not speak TLS 1.3";
    case SSL_R_WRONG_VERSION_NUMBER:
    case SSL_R_HTTP_REQUEST:
      return "it does not speak TLS";
    case SSL_R_EXCESSIVE_MESSAGE_SIZE:
      return "it shows more certificates than any box has";
    case SSL_R_DECRYPTION_FAILED_OR_BAD_RECORD_MAC:
      return "a record was changed, repeated or left out on the way";
    default:
      return nullptr;
  }
}

}  // namespace

RoadConnection::RoadConnection(asio::ip::tcp::socket socket, asio::ssl::context& context,
                               const RoadTrust& trust, RoadConnectionOwner& owner,
                               std::string address)
    : stream_(std::move(socket), context),
      trust_(trust),
      owner_(&owner),
      address_(std::move(address)) {
  X509_VERIFY_PARAM_set_time(SSL_get0_param(stream_.native_handle()), trust_.judged_at_s());
  Code ignored;
  stream_.set_verify_mode(asio::ssl::verify_peer | asio::ssl::verify_fail_if_no_peer_cert, ignored);
  stream_.set_verify_callback(
      [this](bool good_so_far, asio::ssl::verify_context& chain) {
        return trust_.judge(good_so_far, chain.native_handle(), peer_, refusal_);
      },
      ignored);
}

void RoadConnection::shake_hands(bool dialled) {
  const auto side = dialled ? asio::ssl::stream_base::client : asio::ssl::stream_base::server;
  stream_.async_handshake(side, [this, self = shared_from_this()](const Code& code) {
    if (gone_) return;
    if (code || peer_.serial.empty()) return end(text_of(code));
    shaken_ = true;
    if (owner_ != nullptr) owner_->connection_shaken(*this);
    read_more();
  });
}

std::string RoadConnection::text_of(const Code& code) const {
  if (!refusal_.empty()) return refusal_;
  if (code == asio::error::eof || code == asio::ssl::error::stream_truncated) {
    return shaken_ ? "the connection was closed" : "the connection was closed in the handshake";
  }
  if (code.category() == asio::error::get_ssl_category()) {
    const char* known = alert_text(ERR_GET_REASON(static_cast<unsigned long>(code.value())));
    if (known != nullptr) return known;
    return "TLS: " + code.message();
  }
  return code.message();
}

void RoadConnection::resume() {
  paused_ = false;
  read_more();
}

void RoadConnection::read_more() {
  if (gone_ || leaving_ || paused_ || reading_) return;
  reading_ = true;
  inbox_.resize(kInbox);
  stream_.async_read_some(asio::buffer(inbox_),
                          [this, self = shared_from_this()](const Code& code, std::size_t n) {
                            reading_ = false;
                            on_read(code, n);
                          });
}

void RoadConnection::on_read(const Code& code, std::size_t n) {
  if (gone_ || leaving_) return;
  if (code) return end(text_of(code));
  const auto status = reader_.feed(std::span<const std::uint8_t>(inbox_).first(n),
                                   [this](RoadKind kind, std::span<const std::uint8_t> body) {
                                     return owner_ != nullptr &&
                                            owner_->connection_frame(*this, kind, body) && !gone_ &&
                                            !leaving_;
                                   });
  if (gone_ || leaving_) return;
  if (status == RoadFrameStatus::kStopped) return end("refused");
  if (status != RoadFrameStatus::kOk) return end(to_text(status));
  read_more();
}

void RoadConnection::send() {
  if (gone_ || written_ < writing_.size() || waiting_.empty()) return;
  writing_.swap(waiting_);
  waiting_.clear();
  written_ = 0;
  write_more();
}

void RoadConnection::write_more() {
  const std::size_t n = std::min(kChunk, writing_.size() - written_);
  stream_.async_write_some(asio::buffer(writing_.data() + written_, n),
                           [this, self = shared_from_this()](const Code& code, std::size_t done) {
                             on_written(code, done);
                           });
}

void RoadConnection::on_written(const Code& code, std::size_t n) {
  if (gone_) return;
  if (code) return leaving_ ? close() : end(text_of(code));
  written_ += n;
  if (written_ < writing_.size()) return write_more();
  writing_.clear();
  written_ = 0;
  send();
  if (leaving_ && left() == 0) drain();
}

void RoadConnection::close() noexcept {
  gone_ = true;
  owner_ = nullptr;
  Code ignored;
  stream_.next_layer().close(ignored);
}

void RoadConnection::close_gently() {
  if (gone_ || leaving_) return;
  leaving_ = true;
  owner_ = nullptr;
  send();
  if (left() == 0) drain();
}

void RoadConnection::drain() {
  Code ignored;
  stream_.next_layer().shutdown(asio::ip::tcp::socket::shutdown_send, ignored);
  inbox_.resize(kInbox);
  // Under TLS: nobody reads it any more. A read of TLS that is still out sees the same end.
  stream_.next_layer().async_read_some(
      asio::buffer(inbox_), [this, self = shared_from_this()](const Code& code, std::size_t) {
        if (gone_) return;
        if (code) return close();
        drain();
      });
}

void RoadConnection::end(const std::string& why) {
  RoadConnectionOwner* owner = owner_;
  const auto self = shared_from_this();
  // An alert may be on its way: it is to arrive before the connection is gone.
  close_gently();
  if (owner != nullptr) owner->connection_closed(*this, why);
}

}  // namespace drivers

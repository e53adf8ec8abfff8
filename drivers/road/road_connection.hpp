// One TLS connection of a road: handshake with both certificates judged, frames in, bytes out. Of
// the road's thread alone. Its end is told once; then it is deaf.
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <memory>
#include <string>
#include <vector>

#include "drivers/road/road_frame.hpp"
#include "drivers/road/trust.hpp"

namespace drivers {

class RoadConnection;

class RoadConnectionOwner {
 public:
  virtual ~RoadConnectionOwner() = default;
  virtual void connection_shaken(RoadConnection& c) = 0;
  // False: the connection ends.
  [[nodiscard]] virtual bool connection_frame(RoadConnection& c, RoadKind kind,
                                              std::span<const std::uint8_t> body) = 0;
  virtual void connection_closed(RoadConnection& c, const std::string& why) = 0;
};

class RoadConnection : public std::enable_shared_from_this<RoadConnection> {
 public:
  RoadConnection(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context& context,
                 const RoadTrust& trust, RoadConnectionOwner& owner, std::string address);

  void shake_hands(bool dialled);
  // Valid after the handshake.
  [[nodiscard]] const RoadPeer& peer() const noexcept { return peer_; }
  [[nodiscard]] const std::string& address() const noexcept { return address_; }
  [[nodiscard]] int fd() { return stream_.next_layer().native_handle(); }

  // Frames appended here go out with send().
  [[nodiscard]] std::vector<std::uint8_t>& out() noexcept { return waiting_; }
  void send();
  // Bytes that the kernel has not taken yet.
  [[nodiscard]] std::size_t left() const noexcept {
    return waiting_.size() + writing_.size() - written_;
  }
  void allow_messages(std::size_t cap) noexcept { reader_.allow_messages(cap); }
  // Frames that come meanwhile wait in the kernel.
  void pause() noexcept { paused_ = true; }
  void resume();

  // At once; the owner is not told.
  void close() noexcept;
  // What waits is sent, then what still comes is drained, so that the other end can read the last
  // words before the connection is gone. The owner is not told; close() ends it when it takes long.
  void close_gently();
  [[nodiscard]] bool gone() const noexcept { return gone_; }

 private:
  using Code = boost::system::error_code;
  void read_more();
  void on_read(const Code& code, std::size_t n);
  void write_more();
  void on_written(const Code& code, std::size_t n);
  void drain();
  void end(const std::string& why);
  [[nodiscard]] std::string text_of(const Code& code) const;

  boost::asio::ssl::stream<boost::asio::ip::tcp::socket> stream_;
  const RoadTrust& trust_;
  RoadConnectionOwner* owner_;  // null: it is told nothing any more
  std::string address_, refusal_;
  RoadPeer peer_;
  RoadFrameReader reader_;
  std::vector<std::uint8_t> inbox_, waiting_, writing_;
  std::size_t written_ = 0;
  bool shaken_ = false, paused_ = false, reading_ = false, leaving_ = false, gone_ = false;
};

}  // namespace drivers

#include "drivers/link/endpoint.hpp"

#include <algorithm>
#include <cinttypes>
#include <cstdio>

namespace drivers {

namespace {
constexpr rt::Nanos kClockPeriod = std::chrono::milliseconds{200};
constexpr rt::Nanos kClockPeriodAtStart = std::chrono::milliseconds{20};
constexpr int kClockRepliesAtStart = 8;
constexpr rt::Nanos kAlivePeriod = std::chrono::milliseconds{10};
}  // namespace

LinkEndpoint::LinkEndpoint(rt::NonRealtime&, rt::Box box)
    : box_(box), buffer_(kHeaderSize + kMaxBody) {}

void LinkEndpoint::add_outgoing(MessageId id, rt::Nanos period, bool bulk, Fill fill,
                                Urgent urgent) {
  outgoing_.push_back({id, period, bulk, std::move(fill), std::move(urgent), {}, 0});
  std::stable_partition(outgoing_.begin(), outgoing_.end(),
                        [](const Outgoing& o) { return !o.bulk; });
}

void LinkEndpoint::add_incoming(MessageId id, Deliver deliver) {
  incoming_[static_cast<std::size_t>(id)] = std::move(deliver);
}

void LinkEndpoint::emit(MessageId id, std::uint64_t seq, std::span<const std::uint8_t> body,
                        rt::Time now, const Send& send) {
  Header h;
  h.id = id;
  h.seq = seq;
  h.stamp_ns = rt::ns_of(now);
  h.schema = id == MessageId::kHello ? schema_ : 0;
  const std::size_t n = write_message(h, body, buffer_);
  ++stats_.sent[static_cast<std::size_t>(id)];
  stats_.bytes_sent += n;
  next_alive_ = now + kAlivePeriod;
  send(std::span(buffer_).first(n));
}

void LinkEndpoint::poll(rt::Time now, bool line_free, const Send& send, rt::Nanos busy_for) {
  if (!hello_sent_) {
    hello_sent_ = true;
    emit(MessageId::kHello, ++control_seq_, {}, now, send);
  }
  if (!hello_ok_) return;
  std::array<std::uint8_t, kMaxControlBody> small{};
  // What is not bulk goes out together, once in gather_; what is urgent does not wait for it.
  const bool turn = now >= next_turn_;
  if (turn) next_turn_ = std::max(next_turn_ + gather_, now + gather_ / 2);
  if (turn && now >= next_clock_) {
    next_clock_ =
        now + (clock_replies_ < kClockRepliesAtStart ? kClockPeriodAtStart : kClockPeriod);
    emit(MessageId::kClockRequest, ++control_seq_,
         std::span(small).first(encode(ClockRequest{rt::ns_of(now)}, small)), now, send);
  }
  if (ask_ && ready()) ask_(now, line_free ? rt::Nanos{0} : busy_for);
  for (auto& o : outgoing_) {
    const bool due = (now >= o.next && (turn || o.bulk)) || (o.urgent && o.urgent());
    if (!due || (o.bulk && !line_free)) continue;
    // Bodies are built behind the header's place, so an image is copied once.
    const std::size_t n = o.fill(std::span(buffer_).subspan(kHeaderSize));
    if (n == 0) continue;
    o.next = std::max(o.next + o.period, now + o.period / 2);
    emit(o.id, ++o.seq, std::span(buffer_).subspan(kHeaderSize, n), now, send);
    if (o.bulk) line_free = false;
  }
  if (turn && now >= next_alive_) emit(MessageId::kAlive, ++control_seq_, {}, now, send);
}

bool LinkEndpoint::on_hello(const Header& h) {
  if (h.version == kSchemaVersion && h.schema == schema_) {
    hello_ok_ = true;
    return true;
  }
  char text[240];
  std::snprintf(text, sizeof text,
                "link: the other side speaks schema version %u (%016" PRIx64
                "), this side %u (%016" PRIx64
                "): install the same teletact on both boxes, with the same link.depth_codec and "
                "link.colour_codec",
                h.version, h.schema, kSchemaVersion, schema_);
  fault_ = text;
  return false;
}

bool LinkEndpoint::receive(std::span<const std::uint8_t> message, rt::Time now, const Send& send) {
  const bool ok = take(message, now, send);
  if (tap_) tap_(message, now, ok);
  return ok;
}

bool LinkEndpoint::take(std::span<const std::uint8_t> message, rt::Time now, const Send& send) {
  Header h;
  WireStatus status = read_header(message, h);
  const auto body = message.subspan(std::min(kHeaderSize, message.size()));
  if (status == WireStatus::kOk && body.size() != h.length) status = WireStatus::kIncomplete;
  if (status == WireStatus::kOk && crc32c(body) != h.crc) status = WireStatus::kBadCrc;
  if (status != WireStatus::kOk) {
    fault_ = std::string("link: ") + to_text(status);
    return false;
  }
  if (h.id == MessageId::kHello) return on_hello(h);
  if (!hello_ok_) {
    fault_ = "link: a message before the handshake";
    return false;
  }
  const auto index = static_cast<std::size_t>(h.id);
  ++stats_.received[index];
  stats_.bytes_received += message.size();
  bool taken = true;
  if (h.id == MessageId::kClockRequest) {
    ClockRequest request;
    taken = decode(body, request);
    std::array<std::uint8_t, 64> small{};
    const std::int64_t t = rt::ns_of(now);
    if (taken) {
      emit(MessageId::kClockReply, ++control_seq_,
           std::span(small).first(encode(ClockReply{request.t0_ns, t, t}, small)), now, send);
    }
  } else if (h.id == MessageId::kClockReply) {
    ClockReply reply;
    clock_replies_ = std::min(clock_replies_ + 1, kClockRepliesAtStart);
    taken =
        decode(body, reply) && clock_.add(reply.t0_ns, reply.t1_ns, reply.t2_ns, rt::ns_of(now));
  } else if (h.id == MessageId::kBye) {
    bye_ = true;
  } else if (h.id == MessageId::kAlive) {
    taken = body.empty();
  } else if (!clock_.valid() || !plausible_instant(h.stamp_ns)) {
    taken = false;  // its stamps can not be read (yet)
  } else if (incoming_[index]) {
    arrived_ = now;
    arrived_seq_ = h.seq;
    taken = incoming_[index](body, to_local(h.stamp_ns));
  }
  if (taken) {
    last_heard_ = now;
    ever_heard_ = true;
  } else {
    ++stats_.refused[index];
  }
  return true;
}

void LinkEndpoint::send_bye(rt::Time now, const Send& send) {
  if (hello_ok_) emit(MessageId::kBye, ++control_seq_, {}, now, send);
}

void LinkEndpoint::renew() noexcept {
  clock_ = {};
  next_clock_ = next_alive_ = next_turn_ = {};
  hello_sent_ = hello_ok_ = bye_ = false;
  control_seq_ = arrived_seq_ = 0;
  clock_replies_ = wish_ = 0;
  fault_.clear();
  for (const auto& renewed : renewed_) renewed();
}

}  // namespace drivers

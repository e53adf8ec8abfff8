#include "tasks/graph/picture_link.hpp"

#include <memory>

#include "drivers/link/frame_codec.hpp"

namespace tasks {

namespace {

constexpr Wire kWire = kEdge<EdgeId::kFrame>.row.wire;
constexpr rt::Nanos kReportPeriod = std::chrono::milliseconds{20};
constexpr std::uint64_t kReportEvery = 3;  // frames; at once while a key is wanted

void send_asked(EdgeCells<rt::Box::kRobot>& cells, drivers::FrameAsker& asker,
                drivers::LinkEndpoint& endpoint, const std::function<void(drivers::Spared)>& told) {
  endpoint.on_renew([&asker] { asker.renew(); });
  const auto polled = std::make_shared<rt::Time>();
  endpoint.set_ask([&, polled, told](rt::Time now, rt::Nanos busy_for) {
    *polled = now;
    asker.wish(endpoint.wish());
    const auto demand = asker.poll(now, busy_for, endpoint.last_heard());
    if (!demand) return;
    if (told) told(asker.spared());
    cells.begin_write<EdgeId::kDemand>() = *demand;
    cells.publish<EdgeId::kDemand>(now);
  });
  endpoint.add_outgoing(kWire.code, rt::Nanos{0}, kWire.bulk,
                        [&, polled](std::span<std::uint8_t> out) -> std::size_t {
                          if (!cells.fresh_for_link<EdgeId::kFrame>()) return 0;
                          const auto frame = cells.read_by_link<EdgeId::kFrame>();
                          if (!frame) return 0;
                          const bool answers =
                              asker.sent(*polled, frame->demand, !frame->needs_previous,
                                         drivers::wire_size(*frame));
                          return answers ? drivers::write_wire(*frame, out, asker.spared()) : 0;
                        });
  endpoint.add_incoming(drivers::MessageId::kFrameReport,
                        [&asker](std::span<const std::uint8_t> body, rt::Time) {
                          drivers::FrameReport report;
                          if (!drivers::decode(body, report)) return false;
                          asker.report(report);
                          return true;
                        });
}

}  // namespace

void send_pictures(EdgeCells<rt::Box::kRobot>& cells, drivers::FrameAsker& asker,
                   const drivers::PictureConfig& pictures, drivers::LinkEndpoint& endpoint,
                   const std::function<void(drivers::Spared)>& told) {
  if (pictures.on_demand()) {
    endpoint.speak(pictures.dialect());
    send_asked(cells, asker, endpoint, told);
    return;
  }
  endpoint.add_outgoing(kWire.code, std::chrono::milliseconds{kWire.period_ms}, kWire.bulk,
                        [&cells](std::span<std::uint8_t> out) -> std::size_t {
                          if (!cells.fresh_for_link<EdgeId::kFrame>()) return 0;
                          const auto frame = cells.read_by_link<EdgeId::kFrame>();
                          return frame ? drivers::write_wire(*frame, out) : 0;
                        });
}

void receive_pictures(rt::NonRealtime& nrt, EdgeCells<rt::Box::kOperator>& cells,
                      const CaptureConfig& config, const perception::Intrinsics& camera,
                      drivers::LinkEndpoint& endpoint,
                      const std::function<void(const LinkSample&)>& told) {
  struct Decoder {
    Decoder(rt::NonRealtime& n, const CaptureConfig& c, const perception::Intrinsics& k)
        : scratch(n, c.colour, c.pictures, k, drivers::CodecEnd::kDecodes) {}
    drivers::EncodedFrame encoded;
    drivers::FrameCodecScratch scratch;
    drivers::FrameReport report;
    std::uint64_t told = 0;  // arrivals that were reported
  };
  const auto decoder = std::make_shared<Decoder>(nrt, config, camera);
  endpoint.add_incoming(
      kWire.code, [&, decoder, told](std::span<const std::uint8_t> body, rt::Time) {
        auto& d = *decoder;
        d.report.arrived = endpoint.arrived_seq();
        d.report.key_wanted = 1;  // unless it is decoded
        if (drivers::read_wire(body, d.encoded) != drivers::FrameStatus::kOk) return false;
        const rt::Time exposure = endpoint.to_local(d.encoded.exposure.ns);
        // Fusion takes pictures in order of exposure: after one from ahead it would take none.
        if (endpoint.from_ahead(exposure)) return false;
        auto& slot = cells.begin_write<EdgeId::kFrame>();
        const auto status = drivers::decode(d.encoded, exposure, d.scratch, slot);
        if (status != drivers::FrameStatus::kOk && status != drivers::FrameStatus::kWithoutColour)
          return false;
        d.report.key_wanted = d.scratch.colour_wants_key ? 1 : 0;
        cells.publish<EdgeId::kFrame>(endpoint.arrived(), endpoint.unsure());
        if (told) {
          told({endpoint.arrived(), exposure, d.encoded.exposure.ns,
                static_cast<std::uint32_t>(body.size() + drivers::kHeaderSize), true,
                !d.encoded.needs_previous, d.encoded.spared});
        }
        return true;
      });
  if (!config.pictures.on_demand()) return;
  endpoint.speak(config.pictures.dialect());
  endpoint.on_renew([decoder] { decoder->report.arrived = decoder->told = 0; });
  endpoint.add_outgoing(drivers::MessageId::kFrameReport, kReportPeriod, false,
                        [decoder](std::span<std::uint8_t> out) -> std::size_t {
                          auto& d = *decoder;
                          const bool news = d.report.arrived >= d.told + kReportEvery;
                          if (!news && d.report.key_wanted == 0) return 0;
                          d.told = d.report.arrived;
                          return drivers::encode(d.report, out);
                        });
}

}  // namespace tasks

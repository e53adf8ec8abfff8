// The readers of what crosses the road, and of the files that say who may: frames, certificates,
// lists of revoked ones.
#include <openssl/evp.h>

#include <algorithm>
#include <fstream>

#include "drivers/road/pem.hpp"
#include "drivers/road/road_frame.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {
namespace {

// Of a CA whose key is gone: damage is done to the bytes under the base64.
constexpr char kCa[] =
    "MIIBgjCCATSgAwIBAgIQX1F5oSd1wOkFWQ93bZiXqDAFBgMrZXAwLzERMA8GA1UE"
    "CgwIdGVsZXRhY3QxDDAKBgNVBAsMA2xhYjEMMAoGA1UEAwwDbGFiMB4XDTI1MTIz"
    "MTIzMDAwMFoXDTQ1MTIyNzAwMDAwMFowLzERMA8GA1UECgwIdGVsZXRhY3QxDDAK"
    "BgNVBAsMA2xhYjEMMAoGA1UEAwwDbGFiMCowBQYDK2VwAyEA3jkm6OpOqeuKorD2"
    "6r9aSJBXN+r+LxjHSsOpaXUxLGSjZjBkMBIGA1UdEwEB/wQIMAYBAf8CAQAwDgYD"
    "VR0PAQH/BAQDAgEGMB0GA1UdDgQWBBQXWxd11JfVxeDQLiPtFUEaQLdheDAfBgNV"
    "HSMEGDAWgBQXWxd11JfVxeDQLiPtFUEaQLdheDAFBgMrZXADQQCG11pzOCVT/ZI6"
    "mAwXghqLX9A4UCGU1LiWApZjEzellzOuXdZMXNnGPzbUX++GG9p0QtM6w1yn3u+J"
    "uiWMSQMP";
constexpr char kBox[] =
    "MIIBnzCCAVGgAwIBAgIQam/TftgtmEjFWkMJ7uUehzAFBgMrZXAwLzERMA8GA1UE"
    "CgwIdGVsZXRhY3QxDDAKBgNVBAsMA2xhYjEMMAoGA1UEAwwDbGFiMB4XDTI1MTIz"
    "MTIzMDAwMFoXDTQ1MDMwMjAwMDAwMFowMzERMA8GA1UECgwIdGVsZXRhY3QxDjAM"
    "BgNVBAsMBXJvYm90MQ4wDAYDVQQDDAVyb3ZlcjAqMAUGAytlcAMhAFQbYnsME8bh"
    "yr95lC6rS7GvJlNHS38ZqsHoCdHij4s8o38wfTAMBgNVHRMBAf8EAjAAMA4GA1Ud"
    "DwEB/wQEAwIHgDAdBgNVHSUEFjAUBggrBgEFBQcDAQYIKwYBBQUHAwIwHQYDVR0O"
    "BBYEFAwwqgDENyAIVSQrfZ/xkwNQJkCFMB8GA1UdIwQYMBaAFBdbF3XUl9XF4NAu"
    "I+0VQRpAt2F4MAUGAytlcANBAIjVHOgcF6uYDkI+KtLFF6/FTl7iegzrLFHWs2Sf"
    "m5sSuzisJqtkP7oPjDwqH6sstNTVdHb8GQ7EWvE/S+EEYAs=";
constexpr char kList[] =
    "MIH8MIGvAgEBMAUGAytlcDAvMREwDwYDVQQKDAh0ZWxldGFjdDEMMAoGA1UECwwD"
    "bGFiMQwwCgYDVQQDDANsYWIXDTI2MDEwMTAwMDAwMFoXDTQ1MTIyNzAwMDAwMFow"
    "IzAhAhBJgk++WK6imxvj0tbeKgnPFw0yNjAxMDEwMDAwMDBaoC8wLTAKBgNVHRQE"
    "AwIBAjAfBgNVHSMEGDAWgBQXWxd11JfVxeDQLiPtFUEaQLdheDAFBgMrZXADQQCK"
    "AT9bijy1/+XBldnYnq2IvvG9h25GA7Mk8uHFFYbTws+IPt9MVhzXVShDPLiUICRx"
    "U/4SU/0hWOTF+bSLaq8O";

std::string decoded(const std::string& base64) {
  std::string bytes(3 * base64.size() / 4, '\0');
  EVP_DecodeBlock(reinterpret_cast<unsigned char*>(bytes.data()),
                  reinterpret_cast<const unsigned char*>(base64.data()),
                  static_cast<int>(base64.size()));
  // It fills up with zeros for each '=' at the end.
  const std::size_t text = base64.find_last_not_of('=') + 1;
  bytes.resize(bytes.size() - (base64.size() - text));
  return bytes;
}

void write_pem(const std::filesystem::path& path, const std::string& kind,
               const std::string& bytes) {
  std::string base64(4 * ((bytes.size() + 2) / 3) + 1, '\0');
  const int n = EVP_EncodeBlock(reinterpret_cast<unsigned char*>(base64.data()),
                                reinterpret_cast<const unsigned char*>(bytes.data()),
                                static_cast<int>(bytes.size()));
  base64.resize(static_cast<std::size_t>(n));
  std::ofstream file(path, std::ios::trunc);
  file << "-----BEGIN " << kind << "-----\n";
  for (std::size_t at = 0; at < base64.size(); at += 64) file << base64.substr(at, 64) << "\n";
  file << "-----END " << kind << "-----\n";
}

// A stream as it comes out of TLS, in pieces whose sizes differ; each body is read too.
rt::Result<bool> read_frames(const std::string& stream) {
  drivers::RoadFrameReader reader;
  reader.allow_messages(1000);
  std::string problem;
  const auto take = [&](drivers::RoadKind kind, std::span<const std::uint8_t> body) {
    drivers::RoadGreet greet;
    drivers::RoadToken token;
    std::string words;
    const bool good = kind == drivers::RoadKind::kGreet     ? read_greet(body, greet)
                      : kind == drivers::RoadKind::kWelcome ? drivers::read_welcome(body, token)
                      : kind == drivers::RoadKind::kRefusal ? drivers::read_refusal(body, words)
                                                            : true;
    if (!good) problem = "a body that is none";
    return good;
  };
  const auto all = std::span(reinterpret_cast<const std::uint8_t*>(stream.data()), stream.size());
  std::size_t piece = 1;
  for (std::size_t at = 0; at < all.size(); at += piece) {
    piece = 1 + (7 * piece + 3) % 61;
    const auto status = reader.feed(all.subspan(at, std::min(piece, all.size() - at)), take);
    if (reader.held() > 1008) return rt::Error{"more held than the longest frame"};
    if (status == drivers::RoadFrameStatus::kStopped) return rt::Error{problem};
    if (status != drivers::RoadFrameStatus::kOk) return rt::Error{to_text(status)};
  }
  if (reader.held() > 0) return rt::Error{"ends within a frame"};
  return true;
}

}  // namespace

void FuzzReaders::add_road() {
  std::vector<std::uint8_t> dialling, listening, refused;
  drivers::append_greet({drivers::RoadConnectionKind::kBulk, {1, 2, 3}}, dialling);
  const std::vector<std::uint8_t> message(700, 0x41), token(drivers::kRoadTokenBytes, 7);
  for (const std::size_t n : {1U, 60U, 700U})
    append_road_frame(drivers::RoadKind::kMessage, std::span(message).first(n), dialling);
  append_road_frame(drivers::RoadKind::kWelcome, token, listening);
  append_road_frame(drivers::RoadKind::kMessage, message, listening);
  drivers::append_refusal("busy: operator 'ada' is connected", refused);
  std::vector<std::string> seeds;
  for (const auto* s : {&dialling, &listening, &refused}) seeds.emplace_back(s->begin(), s->end());
  readers_.push_back({"road_frames", std::move(seeds), read_frames, {}, false});

  const std::filesystem::path certificate = folder_ / "road.crt", ca = folder_ / "road_ca.crt",
                              list = folder_ / "road.crl";
  readers_.push_back({"road_certificate",
                      {decoded(kBox)},
                      [certificate](const std::string& b) -> rt::Result<bool> {
                        write_pem(certificate, "CERTIFICATE", b);
                        const auto c = drivers::read_certificate(certificate.string());
                        if (!c) return rt::Error{c.error()};
                        const auto peer = drivers::read_peer(*c.value());
                        if (!peer) return rt::Error{peer.error()};
                        return true;
                      },
                      {},
                      false});
  write_pem(ca, "CERTIFICATE", decoded(kCa));
  readers_.push_back({"road_revoked",
                      {decoded(kList)},
                      [ca, list](const std::string& b) -> rt::Result<bool> {
                        const auto issuer = drivers::read_certificate(ca.string());
                        if (!issuer) return rt::Error{issuer.error()};
                        write_pem(list, "X509 CRL", b);
                        const auto revoked = drivers::read_revoked(list.string(), *issuer.value());
                        if (!revoked) return rt::Error{revoked.error()};
                        return drivers::revoked_number(*revoked.value()) == 2;
                      },
                      {},
                      false});
}

}  // namespace teletact

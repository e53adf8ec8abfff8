// HTTPS: a browser with the lab's certificate, without one, with another lab's, with a revoked one.
#include <openssl/pem.h>
#include <openssl/pkcs12.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>

#include <ctime>
#include <fstream>
#include <sstream>

#include "support.hpp"
#include "tools/keys/key_lab.hpp"
#include "tools/keys/web_lab.hpp"

namespace console_test {
namespace {

using teletact::Refusal;
using teletact::WebLab;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

class ConsoleTls : public Console {
 protected:
  void SetUp() override {
    Console::SetUp();
    lab_ = folder_.path + "/lab";
    make_lab(lab_);
    auto lab = WebLab::open(lab_, std::time(nullptr));
    ASSERT_TRUE(lab) << lab.error();
    const auto box =
        lab.value().issue_web("desk", {"localhost", "127.0.0.1"}, 30, std::time(nullptr));
    ASSERT_TRUE(box) << box.error();
    options_.keys = box.value();
  }
  void TearDown() override {
    Console::TearDown();
    SSL_CTX_free(tls_);
    tls_ = nullptr;
  }
  static void make_lab(const std::string& at) {
    const auto made = teletact::KeyLab::init(at, "lab-1", 3650, std::time(nullptr));
    ASSERT_TRUE(made) << made.error();
  }
  // A browser's certificate of `lab`, through the file that a person would install.
  SSL_CTX* browser(const std::string& lab, const std::string& name) {
    auto opened = WebLab::open(lab, std::time(nullptr));
    const auto made = opened.value().issue_browser(name, 30, std::time(nullptr));
    EXPECT_TRUE(made) << (made ? "" : made.error());
    std::ostringstream bytes;
    bytes << std::ifstream(made.value().file, std::ios::binary).rdbuf();
    const std::string der = bytes.str();
    const auto* at = reinterpret_cast<const unsigned char*>(der.data());
    PKCS12* file = d2i_PKCS12(nullptr, &at, static_cast<long>(der.size()));
    EVP_PKEY* key = nullptr;
    X509* certificate = nullptr;
    STACK_OF(X509)* others = nullptr;
    EXPECT_EQ(PKCS12_parse(file, "wrong", &key, &certificate, nullptr), 0);
    EXPECT_EQ(PKCS12_parse(file, made.value().password.c_str(), &key, &certificate, &others), 1);
    SSL_CTX* c = trusting();
    EXPECT_EQ(SSL_CTX_use_certificate(c, certificate), 1);
    EXPECT_EQ(SSL_CTX_use_PrivateKey(c, key), 1);
    PKCS12_free(file);
    EVP_PKEY_free(key);
    X509_free(certificate);
    sk_X509_pop_free(others, X509_free);
    return c;
  }
  // Believes this lab's servers, and their names.
  SSL_CTX* trusting() const {
    SSL_CTX* c = SSL_CTX_new(TLS_client_method());
    EXPECT_EQ(SSL_CTX_load_verify_locations(c, (lab_ + "/web/ca.crt").c_str(), nullptr), 1);
    SSL_CTX_set_verify(c, SSL_VERIFY_PEER, nullptr);
    EXPECT_EQ(X509_VERIFY_PARAM_set1_host(SSL_CTX_get0_param(c), "localhost", 0), 1);
    return c;
  }
  std::string lab_;
};

TEST_F(ConsoleTls, ABrowserOfTheLabComesIn) {
  tls_ = browser(lab_, "tablet-1");
  start();
  EXPECT_THAT(server_->url(), StartsWith("https://127.0.0.1:"));
  EXPECT_EQ(get("/").status, 200);
  const Reply r = post("/session", "{\"code\":\"" + fresh_code() + "\"}");
  EXPECT_EQ(r.status, 200);
  EXPECT_THAT(r.header("set-cookie"), HasSubstr("; Secure"));
  const std::string cookie = r.header("set-cookie").substr(0, r.header("set-cookie").find(';'));
  const auto s = open(cookie);
  s->text("{\"id\":1,\"act\":\"hold\"}");
  EXPECT_THAT(s->answer(), HasSubstr("\"ok\":true"));
  EXPECT_EQ(server_->people().at(0).name, "tablet-1");
  server_->publish(teletact::ViewKind::kPicture, {}, std::string(500000, 'p'));
  EXPECT_EQ(s->next(4).body().size(), 500000U);
}

TEST_F(ConsoleTls, NobodyElseGetsAByteOfThePage) {
  start();
  const std::string wish = "GET / HTTP/1.1\r\nHost: " + host() + "\r\n\r\n";
  const auto refused_with = [&](SSL_CTX* c) {
    Wire wire(server_->port(), c);
    wire.send(wish);
    const std::string said = wire.receive();
    SSL_CTX_free(c);
    return said;
  };
  EXPECT_EQ(refused_with(trusting()), "") << "no certificate";
  make_lab(folder_.path + "/other");
  EXPECT_EQ(refused_with(browser(folder_.path + "/other", "tablet-1")), "") << "of another lab";
  Wire plain(server_->port());
  plain.send(wish);
  EXPECT_THAT(plain.receive(), Not(HasSubstr("doctype"))) << "without TLS";
  EXPECT_TRUE(wait_for([&] { return refused(Refusal::kCertificate) == 3; }));
  SSL_CTX* old = browser(lab_, "old-tablet");
  SSL_CTX_set_max_proto_version(old, TLS1_2_VERSION);
  EXPECT_EQ(refused_with(old), "") << "TLS 1.2";
}

TEST_F(ConsoleTls, ARevokedBrowserIsPutOut) {
  tls_ = browser(lab_, "lost");
  start();
  const auto s = open(join_operator());
  ASSERT_TRUE(wait_for([&] { return server_->viewers() == 1; }));
  auto lab = WebLab::open(lab_, std::time(nullptr));
  ASSERT_EQ(lab.value().revoke("lost", std::time(nullptr)).value(), 1);
  EXPECT_EQ(s->close_code(), 4001);
  EXPECT_TRUE(wait_for([&] { return server_->viewers() == 0; }));
  EXPECT_TRUE(server_->people().empty());
  EXPECT_EQ(get("/").status, 0);
}

TEST_F(ConsoleTls, WhatTheLabMakesIsWhatBrowsersTake) {
  auto lab = WebLab::open(lab_, std::time(nullptr));
  const std::int64_t now = std::time(nullptr);
  EXPECT_THAT(lab.value().issue_web("desk", {}, 30, now).error(), HasSubstr("host"));
  EXPECT_THAT(lab.value().issue_web("desk", {"a b"}, 30, now).error(), HasSubstr("a b"));
  EXPECT_THAT(lab.value().issue_web("desk", {"x,DNS:evil"}, 30, now).error(), HasSubstr("evil"));
  EXPECT_THAT(lab.value().issue_web("../x", {"a"}, 30, now).error(), HasSubstr("../x"));
  EXPECT_THAT(lab.value().issue_web("desk", {"a"}, 900, now).error(), HasSubstr("1..800"));
  ASSERT_TRUE(lab.value().issue_browser("pad", 30, now));
  EXPECT_THAT(lab.value().issue_browser("pad", 30, now).error(), HasSubstr("not overwritten"));
  EXPECT_EQ(lab.value().list().value().size(), 2U);
  const auto c = drivers::read_certificate(options_.keys + "/web.crt");
  ASSERT_TRUE(c) << c.error();
  X509& x = *c.value();
  EXPECT_EQ(X509_check_host(&x, "localhost", 0, 0, nullptr), 1);
  EXPECT_EQ(X509_check_ip_asc(&x, "127.0.0.1", 0), 1);
  EXPECT_EQ(X509_check_host(&x, "elsewhere", 0, 0, nullptr), 0);
  EXPECT_EQ(X509_get_signature_nid(&x), NID_ecdsa_with_SHA256);
  EXPECT_EQ(X509_check_purpose(&x, X509_PURPOSE_SSL_SERVER, 0), 1);
  EXPECT_EQ(X509_check_purpose(&x, X509_PURPOSE_SSL_CLIENT, 0), 0);
}

}  // namespace
}  // namespace console_test

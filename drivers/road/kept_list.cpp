#include "drivers/road/kept_list.hpp"

#include <fcntl.h>
#include <openssl/pem.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace drivers {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kNameDigits = 16;  // of the CA's digest, in the file's name

// On the disk when it returns, for a robot may lose its power at any time. Empty: done.
std::string write_through(const std::string& path, const char* bytes, std::size_t size) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd < 0) return std::strerror(errno);
  const ssize_t n = ::write(fd, bytes, size);
  std::string problem;
  if (n < 0)
    problem = std::strerror(errno);
  else if (n != static_cast<ssize_t>(size))
    problem = "could not be written whole";
  if (problem.empty() && ::fsync(fd) != 0) problem = std::strerror(errno);
  if (::close(fd) != 0 && problem.empty()) problem = std::strerror(errno);
  return problem;
}

}  // namespace

KeptList::KeptList(const std::string& folder, const X509& ca) : folder_(folder) {
  if (!folder.empty()) path_ = folder + "/revoked-" + digest_of(ca).substr(0, kNameDigits) + ".crl";
}

rt::Result<RevokedPtr> KeptList::read(X509& ca) const {
  std::error_code ec;
  if (path_.empty() || fs::symlink_status(path_, ec).type() == fs::file_type::not_found)
    return RevokedPtr{};
  return read_revoked(path_, ca);
}

std::string KeptList::keep(const X509_CRL& list) const {
  if (path_.empty()) return {};
  std::error_code ec;
  if (fs::create_directories(folder_, ec)) fs::permissions(folder_, fs::perms::owner_all, ec);
  if (ec) return folder_ + ": " + ec.message();
  const std::unique_ptr<BIO, decltype(&BIO_free)> out(BIO_new(BIO_s_mem()), &BIO_free);
  char* bytes = nullptr;
  if (!out || PEM_write_bio_X509_CRL(out.get(), &list) != 1) return path_ + ": " + openssl_text();
  const auto size = static_cast<std::size_t>(BIO_get_mem_data(out.get(), &bytes));
  const std::string beside = path_ + ".new";
  if (const std::string problem = write_through(beside, bytes, size); !problem.empty()) {
    ::unlink(beside.c_str());
    return beside + ": " + problem;
  }
  if (::rename(beside.c_str(), path_.c_str()) != 0) return path_ + ": " + std::strerror(errno);
  return {};
}

}  // namespace drivers

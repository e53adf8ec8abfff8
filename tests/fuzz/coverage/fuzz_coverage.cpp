// The seam between libFuzzer and FuzzReaders: one reader a process.
//
//   fuzz_coverage --list                         names of the readers
//   fuzz_coverage --reader=NAME --seeds=FOLDER   writes the good files of the reader there, and
//                                                ends
//   fuzz_coverage --reader=NAME FOLDER ...       libFuzzer's own options and corpus folders
//
// libFuzzer leaves options that begin with two dashes to the program. A reader ends with a result
// or with one line; an exception, an empty line or two lines are aborts, so libFuzzer keeps the
// input.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>

#include "tools/measure/fuzz_readers.hpp"

// libFuzzer's interface: its names.
extern "C" {
std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);
int LLVMFuzzerInitialize(int* argc, char*** argv);
int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                    unsigned seed);
}

namespace {

const teletact::FuzzReader* chosen = nullptr;

const teletact::FuzzReaders& readers() {
  static const teletact::FuzzReaders all;
  return all;
}

// For run.sh: it must be caught. Wrong for what begins with "b" and no seed does.
const teletact::FuzzReader& wrong_reader() {
  static const teletact::FuzzReader reader{"wrong",
                                           {"a good file"},
                                           [](const std::string& b) -> rt::Result<bool> {
                                             if (b.starts_with('b')) return rt::Error{"two\nlines"};
                                             return true;
                                           },
                                           {},
                                           false};
  return reader;
}

std::string option(int argc, char** argv, const char* name) {
  const std::size_t length = std::strlen(name);
  for (int i = 1; i < argc; ++i)
    if (std::strncmp(argv[i], name, length) == 0) return argv[i] + length;
  return {};
}

[[noreturn]] void refuse(const std::string& said) {
  std::cerr << said << "\n";
  std::exit(2);
}

void write_seeds(const std::string& folder) {
  std::filesystem::create_directories(folder);
  for (std::size_t n = 0; n < chosen->seeds.size(); ++n)
    std::ofstream(folder + "/seed" + std::to_string(n), std::ios::binary) << chosen->seeds[n];
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  for (int i = 1; i < *argc; ++i) {
    if (std::strcmp((*argv)[i], "--list") != 0) continue;
    for (const auto& reader : readers().all()) std::cout << reader.name << "\n";
    std::cout.flush();
    std::exit(0);
  }
  const std::string name = option(*argc, *argv, "--reader=");
  for (const auto& reader : readers().all())
    if (reader.name == name) chosen = &reader;
  if (name == wrong_reader().name) chosen = &wrong_reader();
  if (chosen == nullptr) refuse("--reader=" + name + ": --list tells which there are");
  const std::string seeds = option(*argc, *argv, "--seeds=");
  if (!seeds.empty()) {
    write_seeds(seeds);
    std::exit(0);
  }
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  try {
    const auto result = chosen->read(bytes);
    if (!result && (result.error().empty() || result.error().find('\n') != std::string::npos)) {
      std::cerr << "message that is no line: " << result.error() << "\n";
      std::abort();
    }
  } catch (const std::exception& e) {
    std::cerr << "exception: " << e.what() << "\n";
    std::abort();
  }
  return 0;
}

// Every other time the checksums are made good again, so that the damage gets past them.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
  size = LLVMFuzzerMutate(data, size, max_size);
  if (!chosen->seal || (seed & 1U) != 0) return size;
  std::string bytes(reinterpret_cast<const char*>(data), size);
  chosen->seal(bytes);
  if (bytes.empty() || bytes.size() > max_size) return size;
  std::memcpy(data, bytes.data(), bytes.size());
  return bytes.size();
}

#include "tools/measure/fuzz_readers.hpp"

#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "drivers/camera/recording/tum_files.hpp"
#include "drivers/camera/tum_reader.hpp"
#include "drivers/codec/colour_stream.hpp"
#include "perception/map_file/map_file.hpp"
#include "tools/files/csv.hpp"
#include "tools/files/image_files.hpp"
#include "tools/files/npy.hpp"
#include "tools/files/pose_file.hpp"

namespace teletact {
namespace {

constexpr int kWidth = 32, kHeight = 24;

std::span<const std::uint8_t> view(const std::string& bytes) {
  return {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()};
}

template <class T>
rt::Result<bool> outcome(const rt::Result<T>& r) {
  if (!r) return rt::Error{r.error()};
  return true;
}

// A slope with a step, some readings missing.
cv::Mat depth_image(int type) {
  cv::Mat m(kHeight, kWidth, type);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const int mm = u == 3 ? 0 : (u < 16 ? 900 : 1300) + 5 * v;
      if (type == CV_16UC1) {
        m.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(mm);
      } else {
        m.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(mm / 8);
      }
    }
  }
  return m;
}

cv::Mat colour_image() {
  cv::Mat m(kHeight, kWidth, CV_8UC3);
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u)
      m.at<cv::Vec3b>(v, u) = {static_cast<std::uint8_t>(7 * u), static_cast<std::uint8_t>(9 * v),
                               static_cast<std::uint8_t>(u * v)};
  return m;
}

std::string encoded(const char* kind, const cv::Mat& image) {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(kind, image, bytes)) throw std::runtime_error("an image could not be encoded");
  return {bytes.begin(), bytes.end()};
}

// The CRC of every chunk, as far as the lengths lead.
void seal_png(std::string& b) {
  for (std::size_t at = 8; at + 12 <= b.size();) {
    const auto byte = [&](std::size_t i) { return std::uint32_t{view(b)[at + i]}; };
    const std::size_t length = byte(0) << 24U | byte(1) << 16U | byte(2) << 8U | byte(3);
    if (length > b.size() - at - 12) return;
    const std::uint32_t crc = drivers::png_crc(view(b).subspan(at + 4, length + 4));
    for (unsigned i = 0; i < 4; ++i)
      b[at + 8 + length + i] = static_cast<char>((crc >> (24U - 8 * i)) & 0xffU);
    at += length + 12;
  }
}

void write(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

}  // namespace

FuzzReaders::FuzzReaders() {
  // In memory where there is such a folder: on a disk every rewritten input waits for the blocks it
  // gives back.
  const std::filesystem::path memory = "/dev/shm";
  const auto base =
      access(memory.c_str(), W_OK) == 0 ? memory : std::filesystem::temp_directory_path();
  std::string name = (base / "teletact_fuzz_XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw std::runtime_error(name + ": can not be made");
  folder_ = name;
  drivers::opencv_threads_off();
  add_images();
  add_recording();
  add_layouts();
  add_tables();
  add_map();
  add_colour();
  add_depth_stream();
  add_depth_lossless();
  add_store();
  add_link();
  add_road();
  add_bus();
  add_bus_replies();
  add_desk();
  add_console();
}

FuzzReaders::~FuzzReaders() {
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

void FuzzReaders::add_images() {
  const std::string colour = encoded(".png", colour_image()),
                    jpeg = encoded(".jpg", colour_image());
  const std::string deep = encoded(".png", depth_image(CV_16UC1)),
                    grey = encoded(".png", depth_image(CV_8UC1));
  const auto add = [&](const char* name, std::vector<std::string> seeds, auto read) {
    readers_.push_back({name, std::move(seeds), read, seal_png, false});
  };
  add("colour_image", {colour, jpeg, grey},
      [](const std::string& b) { return outcome(decode_colour(view(b), "fuzz")); });
  add("grey_image", {deep, grey},
      [](const std::string& b) { return outcome(decode_grey(view(b), "fuzz")); });
  add("depth_frame", {deep}, [](const std::string& b) {
    return outcome(drivers::decode_image(view(b), "fuzz", CV_16UC1, kWidth, kHeight));
  });
  add("colour_frame", {colour, jpeg}, [](const std::string& b) {
    return outcome(drivers::decode_image(view(b), "fuzz", CV_8UC3, kWidth, kHeight));
  });
}

// One file of a good folder is damaged; then the folder is opened and its first frame read. A
// folder each, for readers may run at once.
void FuzzReaders::add_recording() {
  struct File {
    const char *name, *text;
  };
  static constexpr File kFiles[] = {
      {"intrinsics.txt", "# fx fy cx cy width height units\n30 31 15.5 11.5 32 24 1000\n"},
      {"associations.txt",
       "# t rgb t depth\n100.0 rgb/0.png 100.0 depth/0.png\n100.1 rgb/1.png 100.1 depth/1.png\n"},
      {"colour_registration.txt",
       "fx 30\nfy 30\ncx 15.5\ncy 11.5\nR 1 0 0 0 1 0 0 0 1\nt 0.02 0 0\n"},
  };
  const std::string depth = encoded(".png", depth_image(CV_16UC1)),
                    colour = encoded(".png", colour_image());
  const auto frame = std::make_shared<perception::RgbdFrame>();
  for (const File& f : kFiles) {
    const std::string reader =
        "recording_" + std::string(f.name).substr(0, std::strlen(f.name) - 4);
    const std::filesystem::path folder = folder_ / reader;
    std::filesystem::create_directories(folder / "depth");
    std::filesystem::create_directories(folder / "rgb");
    for (const char* n : {"0.png", "1.png"}) {
      write(folder / "depth" / n, depth);
      write(folder / "rgb" / n, colour);
    }
    for (const File& each : kFiles) write(folder / each.name, each.text);
    readers_.push_back({reader,
                        {f.text},
                        [folder, f, frame](const std::string& b) -> rt::Result<bool> {
                          write(folder / f.name, b);
                          drivers::TumOptions options;
                          options.register_colour = true;
                          const auto s = drivers::TumSequence::open(folder.string(), options);
                          rt::Result<bool> result = rt::Error{s ? "" : s.error()};
                          if (s) result = s.value().read(0, *frame);
                          write(folder / f.name, f.text);
                          return result;
                        },
                        {},
                        true});
  }
}

// The layouts as they are downloaded: a list of images, and a pose of 7-Scenes.
void FuzzReaders::add_layouts() {
  const std::string depth = encoded(".png", depth_image(CV_16UC1)),
                    colour = encoded(".png", colour_image());
  const auto frame = std::make_shared<perception::RgbdFrame>();
  const std::string lists[] = {"depth.txt", "rgb.txt"};
  const std::string texts[] = {"# t file\n100.0 depth/0.png\n100.033 depth/1.png\n",
                               "# t file\n100.01 rgb/0.png\n100.05 rgb/1.png\n"};
  for (std::size_t which = 0; which < 2; ++which) {
    const std::string reader = which == 0 ? "recording_depth" : "recording_rgb";
    const std::filesystem::path folder = folder_ / reader, file = folder / lists[which];
    std::filesystem::create_directories(folder / "depth");
    std::filesystem::create_directories(folder / "rgb");
    for (const char* n : {"0.png", "1.png"}) {
      write(folder / "depth" / n, depth);
      write(folder / "rgb" / n, colour);
    }
    for (std::size_t i = 0; i < 2; ++i) write(folder / lists[i], texts[i]);
    readers_.push_back({reader,
                        {texts[which]},
                        [folder, file, frame](const std::string& b) -> rt::Result<bool> {
                          write(file, b);
                          drivers::TumOptions options;
                          options.pinhole = {30, 31, 15.5, 11.5, 1000};
                          const auto s = drivers::TumSequence::open(folder.string(), options);
                          if (!s) return rt::Error{s.error()};
                          return s.value().read(0, *frame);
                        },
                        {},
                        true});
  }
  const std::filesystem::path scene = folder_ / "recording_pose";
  std::filesystem::create_directories(scene);
  readers_.push_back({"recording_pose",
                      {"1 0 0 0.5\n0 0 -1 0.25\n0 1 0 -2e-1\n0 0 0 1\n"},
                      [scene](const std::string& b) {
                        write(scene / "frame-000007.pose.txt", b);
                        return outcome(read_truth(scene.string()));
                      },
                      {},
                      true});
}

void FuzzReaders::add_tables() {
  const std::filesystem::path odometry = folder_ / "odometry.txt";
  readers_.push_back(
      {"odometry",
       {"# t tx ty tz qx qy qz qw\n0.0 0 0 0 0 0 0 1\n0.1 0.01 0 0 0 0 0.0998 0.995\n"},
       [odometry](const std::string& b) {
         write(odometry, b);
         return outcome(read_poses(odometry.string()));
       },
       {},
       true});
  readers_.push_back({"csv",
                      {"t_s,x,y,z\n0,0.1,0.2,0.3\n0.001,0.1,0.2,0.31\n"},
                      [](const std::string& b) -> rt::Result<bool> {
                        const auto table = parse_csv(b, "fuzz");
                        if (!table) return rt::Error{table.error()};
                        for (std::size_t r = 0; r < table.value().rows.size(); ++r) {
                          const auto n = table.value().number(r, 0);
                          if (!n) return rt::Error{n.error()};
                        }
                        return true;
                      },
                      {},
                      true});
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4), }";
  header.resize(117, ' ');
  header += '\n';
  std::string npy("\x93NUMPY\x01\x00", 8);
  npy += static_cast<char>(header.size());
  npy += '\0';
  npy += header + std::string(4 * 24, '\x3f');
  readers_.push_back(
      {"npy", {npy}, [](const std::string& b) { return outcome(parse_npy(b, "fuzz")); }, {}, true});
}

void FuzzReaders::add_map() {
  struct Held {
    rt::Startup startup;
    perception::TsdfMap map;
    perception::Keyframes keyframes;
    explicit Held(const perception::TsdfConfig& c)
        : map(startup.token(), c), keyframes(startup.token(), {}) {}
  };
  perception::TsdfConfig config;
  config.voxel_size_m = 0.02;
  config.max_blocks = 256;
  config.max_label_blocks = 64;
  config.max_chunks = 16;
  config.far_store_kib = 256;
  const auto held = std::make_shared<Held>(config);
  const cv::Mat depth = depth_image(CV_16UC1);
  const perception::Intrinsics k{60, 60, 15.5, 11.5, kWidth, kHeight};
  std::vector<perception::Rgb> colour(static_cast<std::size_t>(kWidth * kHeight), {90, 120, 200});
  std::vector<std::uint8_t> labels(colour.size(), 0);
  std::fill_n(labels.begin() + 100, 300, std::uint8_t{2});
  std::vector<std::string> seeds;
  for (int n = 0; n < 3; ++n) {
    perception::FrameView frame{k,
                                {depth.ptr<std::uint16_t>(), kWidth, kHeight, kWidth},
                                {colour.data(), kWidth, kHeight, kWidth}};
    perception::Pose X = perception::Pose::Identity();
    X.translation().x() = 0.1 * n;
    held->map.integrate(frame, X, 1);
    if (n > 0) held->map.vote_labels({labels.data(), kWidth, kHeight, kWidth});
    perception::Thumbnail thumbnail;
    thumbnail.depth.fill(static_cast<std::uint8_t>(50 + n));
    held->keyframes.add(X, thumbnail);
    seeds.push_back(encode_map(held->startup.token(), held->map, held->keyframes));
  }
  readers_.push_back({"map", std::move(seeds),
                      [held](const std::string& b) -> rt::Result<bool> {
                        rt::NonRealtime& nrt = held->startup.token();
                        const auto file = perception::parse_map(nrt, b, "fuzz");
                        if (!file) return rt::Error{file.error()};
                        return restore_map(nrt, file.value(), held->map, held->keyframes);
                      },
                      [held](std::string& b) { perception::seal_map(held->startup.token(), b); },
                      false});
}

// Pictures of the link: a key, and of H.264 one that follows it.
void FuzzReaders::add_colour() {
  struct Held {
    rt::Startup startup;
    drivers::ColourDecoder decoder{startup.token()};
    std::vector<perception::Rgb> pixels = std::vector<perception::Rgb>(kWidth * kHeight);
    std::string key;
    [[nodiscard]] drivers::ColourStatus decode(const std::string& bytes) {
      return decoder.decode(view(bytes), {}, {pixels.data(), kWidth, kHeight, kWidth});
    }
  };
  for (const char* method : {"jpeg", "h264"}) {
    if (std::strcmp(method, "h264") == 0 && !drivers::h264_built_in()) continue;
    const auto held = std::make_shared<Held>();
    drivers::ColourStreamConfig config;
    config.method = method;
    const auto encoder = make_colour_encoder(held->startup.token(), config, kWidth, kHeight);
    std::vector<std::string> seeds;
    for (int n = 0; n < 2; ++n) {
      for (int i = 0; i < kWidth * kHeight; ++i)
        held->pixels[static_cast<std::size_t>(i)] = {static_cast<std::uint8_t>(7 * i + 9 * n),
                                                     static_cast<std::uint8_t>(i / kWidth), 90};
      std::vector<std::uint8_t> bytes(drivers::kMostColourBytes);
      const auto coded =
          encoder->encode({held->pixels.data(), kWidth, kHeight, kWidth}, {}, {}, bytes);
      seeds.emplace_back(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(coded.bytes));
    }
    held->key = seeds.front();
    readers_.push_back(
        {std::string("colour_") + method, seeds,
         [held](const std::string& b) -> rt::Result<bool> {
           if (held->decode(held->key) != drivers::ColourStatus::kOk)
             throw std::runtime_error("a good key is refused");
           const auto status = held->decode(b);
           if (status != drivers::ColourStatus::kOk) return rt::Error{to_text(status)};
           return true;
         },
         [](std::string& b) {
           drivers::seal_colour({reinterpret_cast<std::uint8_t*>(b.data()), b.size()});
         },
         false});
  }
}

}  // namespace teletact

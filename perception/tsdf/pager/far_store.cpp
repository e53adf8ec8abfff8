#include "perception/tsdf/pager/far_store.hpp"

#include <algorithm>
#include <array>

namespace perception {

FarStore::FarStore(rt::NonRealtime& nrt, std::size_t bytes, std::size_t max_records)
    : data_(bytes / kPage * kPage),
      next_(bytes / kPage),
      records_(std::min(bytes / kPage, max_records)),
      recycled_(records_.size()),
      index_(nrt, records_.size()) {
  clear();
}

void FarStore::clear() noexcept {
  const auto pages = static_cast<std::int32_t>(next_.size());
  for (std::int32_t p = 0; p < pages; ++p)
    next_[static_cast<std::size_t>(p)] = p + 1 < pages ? p + 1 : kNone;
  free_page_ = pages > 0 ? 0 : kNone;
  pages_taken_ = 0;
  used_records_ = recycled_count_ = 0;
  live_ = blocks_ = 0;
  first_ = last_ = kNone;
  index_.clear();
}

std::size_t FarStore::memory_bytes() const noexcept {
  return data_.size() + next_.size() * sizeof next_[0] + records_.size() * sizeof(Record) +
         recycled_.size() * sizeof recycled_[0] + index_.memory_bytes();
}

void FarStore::add_to(rt::Hash64& h) const noexcept {
  for (std::int32_t r = 0; r < slots(); ++r) {
    if (at(r).first_page == kNone) continue;
    Reader reader(*this, r);
    std::array<std::uint8_t, kPage> part;
    for (std::size_t n = 1; n > 0;) {
      n = std::min(part.size(), reader.left());
      static_cast<void>(reader.read({part.data(), n}));
      h.bytes(part.data(), n);
    }
    h.value(at(r).labels);
  }
}

std::int32_t FarStore::take_page() noexcept {
  const std::int32_t p = free_page_;
  if (p == kNone) return kNone;
  free_page_ = next_[static_cast<std::size_t>(p)];
  next_[static_cast<std::size_t>(p)] = kNone;
  ++pages_taken_;
  return p;
}

void FarStore::free_chain(std::int32_t page) noexcept {
  while (page != kNone) {
    const std::int32_t after = next_[static_cast<std::size_t>(page)];
    next_[static_cast<std::size_t>(page)] = free_page_;
    free_page_ = page;
    --pages_taken_;
    page = after;
  }
}

bool FarStore::begin() noexcept {
  cancel();
  if (static_cast<std::size_t>(live_) == records_.size()) return false;
  first_ = last_ = take_page();
  in_last_ = written_ = 0;
  return first_ != kNone;
}

bool FarStore::append(std::span<const std::uint8_t> bytes) noexcept {
  if (first_ == kNone) return false;
  while (!bytes.empty()) {
    if (in_last_ == kPage) {
      const std::int32_t p = take_page();
      if (p == kNone) {
        cancel();
        return false;
      }
      next_[static_cast<std::size_t>(last_)] = p;
      last_ = p;
      in_last_ = 0;
    }
    const std::size_t n = std::min(bytes.size(), kPage - in_last_);
    std::copy_n(bytes.data(), n, data_.data() + static_cast<std::size_t>(last_) * kPage + in_last_);
    in_last_ += n;
    written_ += n;
    bytes = bytes.subspan(n);
  }
  return true;
}

void FarStore::cancel() noexcept {
  free_chain(first_);
  first_ = last_ = kNone;
}

void FarStore::commit(const Record& about) noexcept {
  if (first_ == kNone) return;
  const std::int32_t r = recycled_count_ > 0
                             ? recycled_[static_cast<std::size_t>(--recycled_count_)]
                             : used_records_++;
  Record& record = records_[static_cast<std::size_t>(r)];
  record = about;
  record.first_page = first_;
  record.bytes = static_cast<std::uint32_t>(written_);
  index_.insert(about.x, about.y, about.z, r);
  ++live_;
  blocks_ += about.blocks;
  first_ = last_ = kNone;
}

void FarStore::drop(std::int32_t r) noexcept {
  Record& record = records_[static_cast<std::size_t>(r)];
  free_chain(record.first_page);
  record.first_page = kNone;
  index_.erase(record.x, record.y, record.z);
  recycled_[static_cast<std::size_t>(recycled_count_++)] = r;
  --live_;
  blocks_ -= record.blocks;
}

bool FarStore::Reader::read(std::span<std::uint8_t> out) noexcept {
  if (out.size() > left_) return false;
  left_ -= out.size();
  while (!out.empty()) {
    if (in_page_ == kPage) {
      page_ = store_->next_[static_cast<std::size_t>(page_)];
      in_page_ = 0;
    }
    const std::size_t n = std::min(out.size(), kPage - in_page_);
    std::copy_n(store_->data_.data() + static_cast<std::size_t>(page_) * kPage + in_page_, n,
                out.data());
    in_page_ += n;
    out = out.subspan(n);
  }
  return true;
}

}  // namespace perception

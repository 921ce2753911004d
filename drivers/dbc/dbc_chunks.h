#pragma once

#include <bit>
#include <cstddef>
#include <iterator>
#include <utility>
#include <vector>

namespace faultline {

/// Gathers items whose number is not known beforehand. A vector that doubles holds up to three
/// times its items while it grows; this holds one chunk more, and `take` makes a vector of exactly
/// its items, giving chunk after chunk free.
template <class T>
class DbcChunks {
 public:
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] T& operator[](std::size_t n) noexcept { return chunks_[n / kItems][n % kItems]; }
  [[nodiscard]] const T& operator[](std::size_t n) const noexcept {
    return chunks_[n / kItems][n % kItems];
  }

  void push_back(T&& item) {
    if (size_ / kItems == chunks_.size()) {
      chunks_.emplace_back();
      // The first one grows as it is needed: most lists are short.
      if (size_ > 0) chunks_.back().reserve(kItems);
    }
    chunks_[size_ / kItems].push_back(std::move(item));
    ++size_;
  }

  /// Appends all to `items`, and is empty then.
  void move_to(std::vector<T>& items) {
    items.reserve(items.size() + size_);
    for (std::size_t n = 0; n < chunks_.size(); ++n) {
      std::move(chunks_[n].begin(), chunks_[n].end(), std::back_inserter(items));
      if (n == 0) {
        chunks_[n].clear();  // keeps its memory for the next list
      } else {
        std::vector<T>().swap(chunks_[n]);
      }
    }
    chunks_.resize(chunks_.empty() ? 0 : 1);
    size_ = 0;
  }

 private:
  /// So large that the heap gives a chunk back to the system when it is freed.
  static constexpr std::size_t kBytes = std::size_t{1} << 20;
  static constexpr std::size_t kItems = std::bit_floor(kBytes / sizeof(T));

  std::vector<std::vector<T>> chunks_;
  std::size_t size_ = 0;
};

}  // namespace faultline

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "drivers/dbc/dbc_database.h"
#include "drivers/dbc/dbc_statement_reader.h"

namespace faultline {

/// Finds signals that share bits though both can be present in one frame.
/// @pre the multiplexers are linked
class DbcOverlapCheck {
 public:
  /// Warns of them, and adds them to `overlaps` as those of the message with this index.
  void check(const DbcMessage& message, std::size_t index, DbcWarnings& warnings,
             std::vector<DbcOverlap>& overlaps);

 private:
  static constexpr std::uint32_t kNoSignal = 0xFFFF'FFFF;

  /// A signal while the multiplexer it hangs on has the values `first` .. `last`.
  struct Item {
    std::uint64_t first = 0;
    std::uint64_t last = 0;
    std::uint32_t signal = 0;
    std::uint32_t branch = 0;  ///< child of the multiplexer through which the signal hangs on it
  };
  struct Owner {
    std::uint64_t last = 0;
    std::uint32_t signal = kNoSignal;
    std::uint32_t branch = kNoSignal;
  };
  /// Of the items on a bit, the one that is present longest, and the one of another branch.
  struct Bit {
    std::uint32_t epoch = 0;
    Owner longest, other;
  };

  void sweep(const DbcMessage& message, DbcWarnings& warnings);
  void place(const DbcMessage& message, const Item& item, DbcWarnings& warnings);
  void report(const DbcMessage& message, std::uint32_t a, std::uint32_t b, DbcWarnings& warnings);

  /// `signal` hangs below `multiplexer`, through its child `branch`.
  struct Level {
    std::uint32_t multiplexer = 0;
    std::uint32_t signal = 0;
    std::uint32_t branch = 0;
  };

  std::size_t index_ = 0;
  std::vector<DbcOverlap>* overlaps_ = nullptr;
  std::vector<Item> items_;
  std::vector<Level> levels_;
  std::vector<Bit> bits_;
  std::vector<bool> is_reported_;
  std::uint32_t epoch_ = 0;
};

}  // namespace faultline

#include "tools/log/message_table.h"

#include <faultline/residual_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::IsSupersetOf;
using testing::Not;

/// Two filters: an observer of two rows, and a linear one.
residual_t residual_message() {
  residual_t message{};
  message.row_count = 3;
  message.residual = {0.1, 0.2, 0.3};
  message.row_threshold = {0.5, 0.25, -1.0};
  message.filter_count = 2;
  message.evaluation = {0.8, 0.3};
  message.threshold = {1.0, 0.4};
  message.fired = {0, 0};
  return message;
}

class MessageTableTest : public testing::Test {
 protected:
  bool read(const residual_t& message) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    LogEvent event{};
    event.channel = kResidualChannel;
    event.data = bytes;
    return table_.read(event, [this](std::span<const Cell> row) {
      row_ = {row.begin(), row.end()};
    });
  }
  [[nodiscard]] Cell cell(const std::string& column) const {
    const auto& columns = table_.columns();
    const auto found = std::find(columns.begin(), columns.end(), column);
    return found == columns.end() ? Cell("no such column")
                                  : row_[static_cast<std::size_t>(found - columns.begin())];
  }

  ChannelNames names_{.residuals = {"o_1", "o_2", "r"}, .filters = {"o", "r"}};
  MessageTable table_{*find_message_type(kResidualChannel), names_, 0};
  std::vector<Cell> row_;
};

TEST_F(MessageTableTest, ShowsTheThresholdsOfRowsThatHaveOne) {
  ASSERT_TRUE(read(residual_message()));
  EXPECT_EQ(cell("o_2"), Cell(0.2));
  EXPECT_EQ(cell("o_1_bound"), Cell(0.5));
  EXPECT_EQ(cell("o_2_bound"), Cell(0.25));
  EXPECT_EQ(cell("o_threshold"), Cell(1.0));
  EXPECT_THAT(table_.columns(), Not(Contains("r_bound")));
}

TEST_F(MessageTableTest, RefusesARowThatHasOtherThresholdsThanTheFirst) {
  ASSERT_TRUE(read(residual_message()));
  residual_t damaged = residual_message();
  damaged.row_threshold[1] = -0.25;
  EXPECT_FALSE(read(damaged));
  EXPECT_TRUE(read(residual_message()));
}

}  // namespace
}  // namespace faultline

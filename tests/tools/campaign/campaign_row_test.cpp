#include "tools/campaign/campaign_row.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace faultline {
namespace {

TEST(CampaignRow, TravelsAsText) {
  CampaignRow row(kRunColumns.size());
  row[column_index("run")] = std::int64_t{1} << 53;
  row[column_index("seed")] = std::int64_t{9'223'372'036'854'775'807};
  row[column_index("point")] = std::string("{\"a\":\"\xc3\xa4 \\\" line\\n\"}");
  row[column_index("size")] = 0.1;
  row[column_index("onset_s")] = 2.0;  // a number of its column's type, not an integer
  EXPECT_EQ(row_of_text(row_text(row)), row);
  EXPECT_EQ(row_text(row).find('\n'), std::string::npos);
}

TEST(CampaignRow, RefusesOtherText) {
  EXPECT_THROW(static_cast<void>(row_of_text("")), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(row_of_text("[1, 2]")), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(row_of_text("{\"run\": 1")), std::invalid_argument);
}

}  // namespace
}  // namespace faultline

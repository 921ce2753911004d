#include "tools/lcm/lcm_url.h"

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace faultline {
namespace {

using testing::HasSubstr;

std::string refusal_of(const std::string& url) {
  try {
    check_lcm_url(url);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(LcmUrl, TakesWhatLiblcmOpens) {
  for (const char* const url :
       {"udpm://", "udpm://239.255.76.67", "udpm://239.255.76.67:7667?ttl=0", "udpm://:7668",
        "udpm://224.0.0.1:1?ttl=255&recv_buf_size=4194304", "mpudpm://239.255.76.67:7667",
        "tcpq://", "tcpq://localhost:7700", "memq://", "file:///tmp/a.lcm?mode=w"}) {
    EXPECT_EQ(refusal_of(url), "") << url;
  }
}

TEST(LcmUrl, SaysWhatIsWrong) {
  EXPECT_THAT(refusal_of("239.255.76.67:7667"), HasSubstr("no \"://\""));
  EXPECT_THAT(refusal_of("udp://239.255.76.67:7667"), HasSubstr("found \"udp\""));
  EXPECT_THAT(refusal_of("udpm://10.0.0.1:7667"), HasSubstr("found \"10.0.0.1\""));
  EXPECT_THAT(refusal_of("udpm://localhost:7667"), HasSubstr("multicast group"));
  EXPECT_THAT(refusal_of("udpm://239.255.76.67:0"), HasSubstr("a port from 1 to 65535"));
  EXPECT_THAT(refusal_of("udpm://239.255.76.67:65536"), HasSubstr("found \"65536\""));
  EXPECT_THAT(refusal_of("udpm://239.255.76.67:76x"), HasSubstr("found \"76x\""));
  EXPECT_THAT(refusal_of("udpm://239.255.76.67:7667?ttl=256"), HasSubstr("from 0 to 255"));
  EXPECT_THAT(refusal_of("udpm://239.255.76.67:7667?ttl"), HasSubstr("ttl="));
  EXPECT_THAT(refusal_of("udpm://239.255.76.67:7667?tll=1"), HasSubstr("found \"tll=1\""));
  EXPECT_THAT(refusal_of("udpm://239.255.76.67:7667?recv_buf_size=0"), HasSubstr("recv_buf_size"));
  EXPECT_THAT(refusal_of("tcpq://localhost:x"), HasSubstr("found \"x\""));
  EXPECT_THAT(refusal_of("file://"), HasSubstr("found no file"));
}

TEST(LcmUrl, CannotListenWithinAProcessOrToAFile) {
  EXPECT_THROW(check_live_lcm_url("memq://"), std::invalid_argument);
  EXPECT_THROW(check_live_lcm_url("file://a.lcm"), std::invalid_argument);
  EXPECT_NO_THROW(check_live_lcm_url("udpm://"));
}

TEST(LcmUrl, KnowsTheSamePlaceByItsDefaults) {
  EXPECT_TRUE(is_same_lcm_place("udpm://", "udpm://239.255.76.67:7667?ttl=1"));
  EXPECT_TRUE(is_same_lcm_place("tcpq://:7700", "tcpq://localhost"));
  EXPECT_FALSE(is_same_lcm_place("udpm://239.255.76.67:7667", "udpm://239.255.76.67:7668"));
  EXPECT_FALSE(is_same_lcm_place("udpm://239.255.76.67:7667", "udpm://239.255.76.68:7667"));
  EXPECT_FALSE(is_same_lcm_place("udpm://", "tcpq://"));
}

}  // namespace
}  // namespace faultline

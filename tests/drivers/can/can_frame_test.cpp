#include "drivers/can/can_frame.h"

#include <gtest/gtest.h>

namespace faultline {
namespace {

TEST(CanFrame, IsWellFormedWithTheLargestIdentifierAndLengthOfItsFormat) {
  CanFrame frame;
  frame.id = 0x7FF;
  frame.length = 8;
  EXPECT_TRUE(is_well_formed(frame));
  frame.is_extended = true;
  frame.id = 0x1FFF'FFFF;
  frame.is_fd = true;
  frame.length = 64;
  frame.is_bit_rate_switched = true;
  frame.is_error_state = true;
  EXPECT_TRUE(is_well_formed(frame));
}

TEST(CanFrame, IsNotWellFormedWithAnIdentifierTooLarge) {
  CanFrame frame;
  frame.id = 0x800;
  EXPECT_FALSE(is_well_formed(frame));
  frame.is_extended = true;
  EXPECT_TRUE(is_well_formed(frame));
  frame.id = 0x2000'0000;
  EXPECT_FALSE(is_well_formed(frame));
}

TEST(CanFrame, IsNotWellFormedWithAPayloadTooLong) {
  CanFrame frame;
  frame.length = 9;
  EXPECT_FALSE(is_well_formed(frame));
  frame.is_fd = true;
  EXPECT_TRUE(is_well_formed(frame));
  frame.length = 65;
  EXPECT_FALSE(is_well_formed(frame));
}

TEST(CanFrame, IsNotWellFormedWithFlagsOfTheOtherFormat) {
  CanFrame classic;
  classic.is_bit_rate_switched = true;
  EXPECT_FALSE(is_well_formed(classic));
  CanFrame remote_fd;
  remote_fd.is_fd = true;
  remote_fd.is_remote = true;
  EXPECT_FALSE(is_well_formed(remote_fd));
}

TEST(CanFrame, IsTheSameOnTheWireWhateverItsStamp) {
  CanFrame a;
  a.data[0] = 1;
  CanFrame b = a;
  b.stamp += std::chrono::seconds(1);
  EXPECT_TRUE(same_on_wire(a, b));
  b.data[0] = 2;
  EXPECT_FALSE(same_on_wire(a, b));
}

TEST(CanFrame, IsNoErrorFrameAndSomethingElseAtOnce) {
  CanFrame frame;
  frame.is_error = true;
  frame.id = kMaxExtendedId;
  EXPECT_TRUE(is_well_formed(frame));
  frame.is_extended = true;
  EXPECT_FALSE(is_well_formed(frame));
  frame.is_extended = false;
  frame.is_remote = true;
  EXPECT_FALSE(is_well_formed(frame));
}

}  // namespace
}  // namespace faultline

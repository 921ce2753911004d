#include "drivers/can/input_backlog.h"

#include <string>

#include <gtest/gtest.h>

namespace faultline {
namespace {

// Lines as Linux 6.1 writes them: packets, drops, squeezes, ... of a CPU, hexadecimal.
const std::string kFirstCpu =
    "0000a7b2 00003325 00000003 00000000 00000000 00000000 00000000 00000000 00000000 00000000 "
    "00000000 00000000 00000000\n";
const std::string kSecondCpu =
    "00000011 ffffffff 00000000 00000000 00000000 00000000 00000000 00000000 00000000 00000000 "
    "00000000 00000000 00000001\n";

TEST(InputBacklog, AddsTheDropsOfAllCpus) {
  EXPECT_EQ(read_backlog_drops(kFirstCpu), 0x3325u);
  EXPECT_EQ(read_backlog_drops(kFirstCpu + kSecondCpu), 0x3325u + 0xffffffffull);
  EXPECT_EQ(read_backlog_drops("1 2\n3 4"), 6u);
}

TEST(InputBacklog, KnowsNothingFromOtherText) {
  for (const char* text : {"", "\n", "00000001\n", "00000001 \n", "00000001 xyz 0\n",
                           "00000001 12z 0\n", "00000001 123456789 0\n", "1 2\n\n3 4\n"}) {
    EXPECT_FALSE(read_backlog_drops(text)) << text;
  }
}

TEST(InputBacklog, SaysWhatToDo) {
  EXPECT_EQ(backlog_drops_text(12),
            "the kernel dropped 12 packets of its interfaces before any socket got them, its input "
            "backlog was full: sudo sysctl -w net.core.netdev_max_backlog=10000");
}

}  // namespace
}  // namespace faultline

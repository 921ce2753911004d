#include "drivers/can/open_bus.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace faultline {
namespace {

std::string refusal_of(std::string_view spec) {
  try {
    check_bus_names(spec);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(OpenBus, SplitsAListOfNames) {
  EXPECT_EQ(split_bus_names("can:vcan0"), std::vector<std::string>{"can:vcan0"});
  EXPECT_EQ(split_bus_names("can:vcan0,udp:[ff15::1]:43113"),
            (std::vector<std::string>{"can:vcan0", "udp:[ff15::1]:43113"}));
  for (const char* spec : {"", ",", "can:a,", ",can:a", "can:a,,can:b"}) {
    EXPECT_THROW(static_cast<void>(split_bus_names(spec)), std::invalid_argument) << spec;
  }
}

TEST(OpenBus, TakesTheNamesOfBuses) {
  for (const char* spec :
       {"can:vcan0", "udp:239.74.163.2:43113", "udp:[ff15::1]:1", "udp:224.0.0.1:65535",
        "udp:[ff15:7079:7468:6f6e:6465:6d6f:6d63:6173]:43113", "udp:[ff02::1%lo]:43113",
        "can:a,can:b,udp:239.1.2.3:4"}) {
    EXPECT_EQ(refusal_of(spec), "") << spec;
  }
}

TEST(OpenBus, SaysWhatItFoundAndExpected) {
  EXPECT_EQ(refusal_of("vcan0"),
            "bus: found \"vcan0\", expected can:IFACE, udp:GROUP:PORT or several with commas "
            "between them, e.g. can:vcan0 or udp:239.74.163.2:43113");
  EXPECT_NE(refusal_of("loop").find("expected a bus with another end"), std::string::npos);
  EXPECT_NE(refusal_of("can:a,loop").find("found \"loop\""), std::string::npos);
  EXPECT_EQ(refusal_of("can:"),
            "bus: found \"can:\", expected the name of an interface: can:IFACE");
  EXPECT_EQ(refusal_of("udp:239.1.2.3"),
            "bus: found \"udp:239.1.2.3\", expected udp:GROUP:PORT, e.g. udp:239.74.163.2:43113");
  for (const char* spec : {"udp:239.1.2.3:0", "udp:239.1.2.3:65536", "udp:239.1.2.3:",
                           "udp:239.1.2.3:-1", "udp:239.1.2.3:1x", "udp:239.1.2.3: 1"}) {
    EXPECT_NE(refusal_of(spec).find("expected a port from 1 to 65535"), std::string::npos) << spec;
  }
  for (const char* spec : {"udp::1", "udp:127.0.0.1:1", "udp:example.org:1", "udp:240.0.0.1:1",
                           "udp:239.1:1", "udp:[fe80::1]:1", "udp:[]:1", "udp:239.1.2.256:1"}) {
    EXPECT_NE(refusal_of(spec).find("expected the number of a multicast group"), std::string::npos)
        << spec << ": " << refusal_of(spec);
  }
  EXPECT_NE(refusal_of("udp:ff15::1:43113").find("expected brackets around"), std::string::npos);
  EXPECT_NE(refusal_of("udp:[239.1.2.3]:1").find("expected brackets around"), std::string::npos);
  EXPECT_NE(refusal_of("udp:[ff15::1]43113").find("udp:[GROUP]:PORT"), std::string::npos);
  EXPECT_NE(refusal_of("udp:[ff15::1").find("udp:[GROUP]:PORT"), std::string::npos);
}

TEST(OpenBus, RefusesBadNamesBeforeItOpensAnything) {
  EXPECT_THROW(static_cast<void>(open_bus("can:nosuch0,nonsense")), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(open_bus("loop")), std::invalid_argument);
}

}  // namespace
}  // namespace faultline

#include "tools/dashboard/viewer_access.h"

#include <random>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

TEST(ListenAddress, IsANumericAddressWithAPort) {
  EXPECT_EQ(parse_listen_address("127.0.0.1:8080").address, "127.0.0.1");
  EXPECT_EQ(parse_listen_address("127.0.0.1:8080").port, 8080);
  EXPECT_EQ(parse_listen_address("[::1]:0").address, "::1");
  for (const char* const text : {"",
                                 ":",
                                 ":80",
                                 "127.0.0.1",
                                 "127.0.0.1:",
                                 "127.0.0.1:x",
                                 "127.0.0.1:-1",
                                 "127.0.0.1:65536",
                                 "127.0.0.1:80 ",
                                 " 127.0.0.1:80",
                                 "127.0.0.1: 80",
                                 "127.0.0.1:+80",
                                 "127.0.0.1:0x50",
                                 "127.1:80",
                                 "1.2.3.4.5:80",
                                 "localhost:80",
                                 "[::1:80",
                                 "[]:80",
                                 "[::1]",
                                 "[::1]80x",
                                 "[::1]80",
                                 "[",
                                 "[]",
                                 "]:80",
                                 "127.0.0.1:80:90"}) {
    EXPECT_THROW(static_cast<void>(parse_listen_address(text)), std::invalid_argument) << text;
  }
}

TEST(ListenAddress, KnowsLoopback) {
  for (const char* const text : {"127.0.0.1:1", "127.255.0.3:1", "[::1]:1"}) {
    EXPECT_TRUE(parse_listen_address(text).is_loopback()) << text;
  }
  for (const char* const text : {"0.0.0.0:1", "[::]:1", "10.0.0.1:1", "128.0.0.1:1"}) {
    EXPECT_FALSE(parse_listen_address(text).is_loopback()) << text;
  }
}

TEST(SameSecret, IsEquality) {
  EXPECT_TRUE(is_same_secret("", ""));
  EXPECT_TRUE(is_same_secret("sesame", "sesame"));
  for (const char* const text :
       {"", "s", "sesam", "sesame1", "sesamE", "sesamesesame", "sesamesesam", "1sesame"}) {
    EXPECT_FALSE(is_same_secret(text, "sesame")) << text;
    EXPECT_FALSE(is_same_secret("sesame", text)) << text;
  }
  EXPECT_FALSE(is_same_secret(std::string(1, '\0'), ""));
  EXPECT_FALSE(is_same_secret(std::string("sesame\0", 7), "sesame"));
}

TEST(SameSecret, AgreesWithEqualityOnRandomTexts) {
  const std::uint64_t seed = test_seed(20261125);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  const auto text = [&draw] {
    std::string result(draw() % 5, '\0');
    for (char& letter : result) letter = static_cast<char>(draw() % 3);
    return result;
  };
  int same = 0;
  for (int i = 0; i < 100'000; ++i) {
    const std::string a = text(), b = text();
    ASSERT_EQ(is_same_secret(a, b), a == b)
        << testing::PrintToString(a) << testing::PrintToString(b);
    same += a == b ? 1 : 0;
  }
  EXPECT_GT(same, 1000);
}

TEST(ViewerAccess, AdmitsHostsThatHaveNoNameOfTheirOwn) {
  const ViewerAccess access{.token = "", .port = 8080};
  for (const char* const host :
       {"localhost:8080", "127.0.0.1:8080", "[::1]:8080", "192.168.1.7:8080"}) {
    EXPECT_TRUE(access.admits_host(host)) << host;
  }
  for (const char* const host : {"",
                                 ":",
                                 ":8080",
                                 "8080",
                                 "localhost",
                                 "localhost:",
                                 "localhost:80",
                                 "localhost:08081",
                                 "localhost:8080 ",
                                 "localhost:8080x",
                                 "localhost.evil.example:8080",
                                 "evil.example:8080",
                                 "127.0.0.1.evil.example:8080",
                                 "127.0.0.1:8080:8080",
                                 "LOCALHOST@evil.example:8080",
                                 "[::1]:8081",
                                 "[::1]8080",
                                 "[::1]",
                                 "[evil.example]:8080",
                                 "[::1].evil.example:8080",
                                 "user@127.0.0.1:8080",
                                 "127.0.0.1:8080@evil.example",
                                 "[localhost:8080"}) {
    EXPECT_FALSE(access.admits_host(host)) << host;
  }
  EXPECT_TRUE((ViewerAccess{.token = "", .port = 80}).admits_host("localhost"));
}

TEST(ViewerAccess, AdmitsAPageOfItsOwnOnly) {
  EXPECT_TRUE(ViewerAccess::admits_origin("http://127.0.0.1:8080", "127.0.0.1:8080"));
  for (const char* const origin :
       {"", "null", "http://", "127.0.0.1:8080", "https://127.0.0.1:8080", "http://127.0.0.1",
        "http://127.0.0.1:8081", "http://127.0.0.1:8080/", "http://127.0.0.1:80801",
        "http://localhost:8080", "http://evil.example", "http://127.0.0.1:8080.evil.example",
        "HTTP://127.0.0.1:8080", " http://127.0.0.1:8080", "file://127.0.0.1:8080"}) {
    EXPECT_FALSE(ViewerAccess::admits_origin(origin, "127.0.0.1:8080")) << origin;
  }
}

TEST(ViewerAccess, AsksForTheToken) {
  const ViewerAccess access{.token = "sesame", .port = 8080};
  EXPECT_TRUE(access.admits_target("/?token=sesame"));
  EXPECT_TRUE(access.admits_target("/live?token=sesame"));
  for (const char* const target :
       {"", "/", "?", "/?", "/?token", "/?token=", "/?token=sesam", "/?token=sesame1",
        "/?token=sesame&", "/?token=sesame&token=sesame", "/?TOKEN=sesame", "/?token=SESAME",
        "/?x=1&token=sesame", "/token=sesame", "/?token=%73esame", "/?token=sesame ",
        "/??token=sesame", "/#?token=sesamE", "/?token=sesamesesame"}) {
    EXPECT_FALSE(access.admits_target(target)) << target;
  }
  EXPECT_TRUE((ViewerAccess{.token = "", .port = 8080}).admits_target("/"));
}

TEST(ViewerAccess, LetsNobodyInWithRandomHeaders) {
  const std::uint64_t seed = test_seed(20261126);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  const ViewerAccess access{.token = "sesame", .port = 8080};
  const std::string models[] = {"127.0.0.1:8080", "[::1]:8080", "localhost:8080",
                                "/live?token=sesame", "http://127.0.0.1:8080"};
  int admitted = 0;
  for (int i = 0; i < 100'000; ++i) {
    std::string text = models[draw() % std::size(models)];
    for (std::uint64_t n = draw() % 3; n > 0; --n) {
      const std::size_t at = draw() % text.size();
      switch (draw() % 3) {
        case 0:
          text[at] = static_cast<char>(draw());
          break;
        case 1:
          text.insert(at, 1, "0.:[]@/?=x"[draw() % 10]);
          break;
        default:
          text.erase(at, 1 + draw() % 3);
          break;
      }
      if (text.empty()) break;
    }
    if (access.admits_target(text)) {
      ++admitted;
      ASSERT_TRUE(text.ends_with("?token=sesame")) << text;
    }
    if (access.admits_host(text)) {
      ++admitted;
      // "localhost" or letters of a numeric address, then our port, as often as not with zeros.
      const std::size_t colon = text.rfind(':');
      ASSERT_NE(colon, std::string::npos) << text;
      ASSERT_EQ(std::stoi(text.substr(colon + 1)), 8080) << text;
      const std::string host = text.substr(0, colon);
      ASSERT_TRUE(host == "localhost" ||
                  host.find_first_not_of("0123456789abcdefABCDEF.:[]%") == std::string::npos ||
                  host.find('%') != std::string::npos)
          << text;
    }
    ASSERT_EQ(ViewerAccess::admits_origin(text, "127.0.0.1:8080"), text == "http://127.0.0.1:8080");
  }
  EXPECT_GT(admitted, 1000);
}

}  // namespace
}  // namespace faultline

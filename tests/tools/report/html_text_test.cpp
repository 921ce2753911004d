#include "tools/report/html_text.h"

#include <gtest/gtest.h>

namespace faultline {
namespace {

TEST(HtmlText, EscapesWhatCouldBeATagOrAnAttribute) {
  EXPECT_EQ(html("<script>alert('x')</script>"), "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;");
  EXPECT_EQ(html("a\" onload=\"b & c"), "a&quot; onload=&quot;b &amp; c");
}

TEST(HtmlText, KeepsWhatIsUtf8) {
  EXPECT_EQ(html("Δp in m³/s \xF0\x9F\x9A\x97"), "Δp in m³/s \xF0\x9F\x9A\x97");
}

TEST(HtmlText, ReplacesWhatIsNot) {
  const std::string replacement = "\xEF\xBF\xBD";
  EXPECT_EQ(html("a\xFFz"), "a" + replacement + "z");
  EXPECT_EQ(html("\xC3"), replacement);  // cut off
  EXPECT_EQ(html(std::string("\0\x1B", 2)), replacement + replacement);
  EXPECT_EQ(html("\xED\xA0\x80").substr(0, 3), replacement);  // a surrogate
  EXPECT_EQ(html("\xC0\xBC").find('<'), std::string::npos);   // an overlong <
}

TEST(HtmlText, NoTagEndsAScriptFromItsJson) {
  EXPECT_EQ(json_in_script("[\"</script><!--\"]"), "[\"\\u003c/script>\\u003c!--\"]");
}

}  // namespace
}  // namespace faultline

#include "diagnosis/model/toml_draft.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/model/input_error.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr char kText[] =
    "name = \"s\"  # a remark\nduration_s = 10.0\n[controller]\nkind = \"lqr\"\n"
    "[[fault]]\ntarget = \"u1\"\nvalue = 2.0\n[[fault]]\ntarget = \"u2\"\nvalue = 0.1\n";

TomlTable edited(const std::vector<TomlEdit>& edits) {
  return TomlTable::parse(TomlDraft(kText, "s.toml").with(edits), "edited");
}

std::string refusal(const TomlEdit& edit) {
  try {
    static_cast<void>(edited({edit}));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(TomlDraft, WithoutEditsSaysTheSame) {
  TomlTable root = edited({});
  EXPECT_EQ(root.string("name"), "s");
  EXPECT_EQ(root.number("duration_s"), 10.0);
  EXPECT_EQ(root.table("controller").string("kind"), "lqr");
  ASSERT_EQ(root.tables("fault").size(), 2u);
  EXPECT_EQ(root.tables("fault")[1].number("value"), 0.1);
}

TEST(TomlDraft, SetsValuesAtTheirPlaces) {
  TomlTable root = edited({{"duration_s", "0.30000000000000004"},
                           {"controller.kind", "\"none\""},
                           {"fault[2].value", "-3"},
                           {"simulation.uncertainty.friction", "0.5"},
                           {"fault[3]", "{ target = \"y1\", kind = \"stuck\" }"},
                           {"fault[1]", "{ kind = \"gain\" }"}});
  EXPECT_EQ(root.number("duration_s"), 0.30000000000000004);  // to the bit
  EXPECT_EQ(root.table("controller").string("kind"), "none");
  EXPECT_EQ(root.table("simulation").table("uncertainty").number("friction"), 0.5);
  std::vector<TomlTable> faults = root.tables("fault");
  ASSERT_EQ(faults.size(), 3u);
  EXPECT_EQ(faults[0].string("target"), "u1");  // merged into what is there
  EXPECT_EQ(faults[0].string("kind"), "gain");
  EXPECT_EQ(faults[1].number("value"), -3.0);
  EXPECT_EQ(faults[2].string("kind"), "stuck");
}

TEST(TomlDraft, MultipliesNumbers) {
  TomlTable root = edited({{"fault[1].value", "3.0"},
                           {"fault[1].value", "-1", TomlEdit::Kind::kFactor},
                           {"fault[2].value", "0.5", TomlEdit::Kind::kFactor}});
  EXPECT_EQ(root.tables("fault")[0].number("value"), -3.0);
  EXPECT_EQ(root.tables("fault")[1].number("value"), 0.05);
}

TEST(TomlDraft, TakesEntriesOut) {
  TomlTable one = edited({{"fault[1]", "false"}, {"fault[1].value", "7"}});
  ASSERT_EQ(one.tables("fault").size(), 1u);
  EXPECT_EQ(one.tables("fault")[0].string("target"), "u2");
  EXPECT_FALSE(edited({{"fault[1]", "false"}, {"fault[2]", "false"}}).has("fault"));
}

TEST(TomlDraft, RefusesPlacesThatCannotBe) {
  EXPECT_THAT(refusal({"fault[4].value", "1"}), HasSubstr("found 2 entries of fault"));
  EXPECT_THAT(refusal({"duration_s.x", "1"}), HasSubstr("found no table at duration_s"));
  EXPECT_THAT(refusal({"duration_s[1]", "1"}), HasSubstr("found no list at duration_s"));
  EXPECT_THAT(refusal({"fault[1]", "3"}), HasSubstr("expected a table"));
  EXPECT_THAT(refusal({"name", "2", TomlEdit::Kind::kFactor}), HasSubstr("found no number"));
  EXPECT_THAT(refusal({"name", "{ a ="}), HasSubstr("expected a value"));
  for (const char* const place :
       {"", ".", "a.", "a..b", "a[", "a[0]", "a[x]", "a[1", "a b", "a[99999999999999999999]"}) {
    EXPECT_NE(TomlDraft::check_place(place), "") << place;
  }
  EXPECT_EQ(TomlDraft::check_place("fault[1].value"), "");
}

TEST(TomlDraft, RefusesATextThatIsNone) { EXPECT_THROW(TomlDraft("a = ", "s.toml"), InputError); }

TEST(TomlReader, TellsValuesAsTheyAreWritten) {
  TomlTable root = TomlTable::parse(
      "list = [1, 0.1, true, \"a b\", { target = \"u1\", at_s = 2.0 }, [1, 2]]\n", "t");
  EXPECT_THAT(root.value_texts("list"), ElementsAre("1", "0.1", "true", "'a b'",
                                                    "{ at_s = 2.0, target = 'u1' }", "[ 1, 2 ]"));
}

}  // namespace
}  // namespace faultline

#include "diagnosis/model/toml_reader.h"

#include <filesystem>
#include <fstream>
#include <functional>
#include <system_error>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace faultline {
namespace {

using ::testing::ElementsAre;
using ::testing::StartsWith;

std::string refusal(const std::string& text, const std::function<void(TomlTable&)>& read) {
  try {
    TomlTable root = TomlTable::parse(text, "f.toml");
    read(root);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(TomlTable, ReadsValuesOfEveryType) {
  TomlTable root = TomlTable::parse(R"(s = "word"
x = 1.5
i = 7
b = true
names = ["a", "b"]
v = [1, 2.5]
A = [[1, 2], [3, 4]]
sets = [["a"], ["a", "b"]]
[sub]
y = 2
[[item]]
z = 1
[[item]]
z = 2
)",
                                    "f.toml");
  EXPECT_EQ(root.string("s"), "word");
  EXPECT_EQ(root.number("x"), 1.5);
  EXPECT_EQ(root.number("i"), 7.0);
  EXPECT_EQ(root.integer("i"), 7);
  EXPECT_TRUE(root.boolean("b"));
  EXPECT_THAT(root.strings("names"), ElementsAre("a", "b"));
  EXPECT_THAT(root.numbers("v"), ElementsAre(1.0, 2.5));
  EXPECT_EQ(root.matrix("A", 2, -1), (Eigen::MatrixXd(2, 2) << 1, 2, 3, 4).finished());
  EXPECT_THAT(root.string_lists("sets"), ElementsAre(ElementsAre("a"), ElementsAre("a", "b")));
  EXPECT_EQ(root.table("sub").number("y"), 2.0);
  std::vector<TomlTable> items = root.tables("item");
  ASSERT_EQ(items.size(), 2u);
  EXPECT_EQ(items[0].integer("z"), 1);
  EXPECT_EQ(items[1].integer("z"), 2);
  EXPECT_THAT(root.keys(),
              ElementsAre("s", "x", "i", "b", "names", "v", "A", "sets", "sub", "item"));
  EXPECT_NO_THROW(root.finish());
}

TEST(TomlTable, GivesNothingForAbsentOptionalValues) {
  TomlTable root = TomlTable::parse("", "f.toml");
  EXPECT_FALSE(root.has("x"));
  EXPECT_FALSE(root.optional_string("x"));
  EXPECT_FALSE(root.optional_number("x"));
  EXPECT_FALSE(root.optional_integer("x"));
  EXPECT_FALSE(root.optional_boolean("x"));
  EXPECT_FALSE(root.optional_strings("x"));
  EXPECT_FALSE(root.optional_vector("x", 2));
  EXPECT_FALSE(root.optional_matrix("x", 2, 2));
  EXPECT_FALSE(root.optional_table("x"));
  EXPECT_TRUE(root.tables("x").empty());
}

TEST(TomlTable, LocatesSyntaxErrors) {
  EXPECT_THAT(refusal("a = 1\nb = = 2\n", [](TomlTable&) {}), StartsWith("f.toml:2:5: not TOML: "));
}

TEST(TomlTable, LocatesUnknownKeysAndSuggestsTheNearest) {
  EXPECT_EQ(refusal("schema = 1\n[dynamics]\nA = 1\nBb = 2\n",
                    [](TomlTable& root) {
                      static_cast<void>(root.integer("schema"));
                      TomlTable dynamics = root.table("dynamics");
                      static_cast<void>(dynamics.number("A"));
                      static_cast<void>(dynamics.optional_number("B"));
                      root.finish();
                    }),
            "f.toml:4:1: dynamics: found unknown key \"Bb\"; did you mean \"B\"?");
  EXPECT_EQ(refusal("zebra = 1\n",
                    [](TomlTable& root) {
                      static_cast<void>(root.optional_number("A"));
                      root.finish();
                    }),
            "f.toml:1:1: found unknown key \"zebra\"; known here: A");
}

TEST(TomlTable, SaysWhatItFoundAndWhatItExpected) {
  const auto matrix = [](TomlTable& root) { static_cast<void>(root.matrix("A", 2, 2)); };
  EXPECT_EQ(refusal("A = 3\n", matrix), "f.toml:1:5: A: found number 3, expected a list of rows");
  EXPECT_EQ(refusal("A = [[1, 2]]\n", matrix), "f.toml:1:5: A: found 1 rows, expected 2 rows");
  EXPECT_EQ(refusal("A = [[1, 2], [3]]\n", matrix),
            "f.toml:1:14: A, row 2: found a list of 1 values, expected a list of 2 numbers");
  EXPECT_EQ(refusal("A = [[1, 2],\n [3, \"x\"]]\n", matrix),
            "f.toml:2:6: A, row 2, entry 2: found string \"x\", expected a finite number");
  EXPECT_EQ(refusal("[t]\nx = nan\n",
                    [](TomlTable& root) { static_cast<void>(root.table("t").number("x")); }),
            "f.toml:2:5: t.x: found number nan, expected a finite number");
  EXPECT_EQ(refusal("x = inf\n", [](TomlTable& root) { static_cast<void>(root.number("x")); }),
            "f.toml:1:5: x: found number inf, expected a finite number");
  EXPECT_EQ(refusal("\n[t]\n",
                    [](TomlTable& root) { static_cast<void>(root.table("t").string("name")); }),
            "f.toml:2:1: t.name: found nothing, expected a string");
  EXPECT_EQ(refusal("x = 1.5\n", [](TomlTable& root) { static_cast<void>(root.integer("x")); }),
            "f.toml:1:5: x: found number 1.5, expected a whole number");
  EXPECT_EQ(refusal("w = \"c\"\n",
                    [](TomlTable& root) {
                      static_cast<void>(root.choice("w", {"a", "b"}));
                    }),
            "f.toml:1:5: w: found \"c\", expected one of \"a\", \"b\"");
}

TEST(TomlTable, ReadsFilesWithByteOrderMarkAndCarriageReturns) {
  TomlTable root = TomlTable::parse("\xEF\xBB\xBFx = 1\r\ny = 2\r\n", "f.toml");
  EXPECT_EQ(root.number("x"), 1.0);
  EXPECT_EQ(root.number("y"), 2.0);
  EXPECT_EQ(refusal("\xEF\xBB\xBFx = 1\r\ny = \"a\"\r\n",
                    [](TomlTable& table) { static_cast<void>(table.number("y")); }),
            "f.toml:2:5: y: found string \"a\", expected a finite number");
}

TEST(TomlTable, KeepsTheTextItRead) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / "kept.toml";
  std::ofstream(file) << "x = 1 # one\n";
  const TomlTable root = TomlTable::read_file(file);
  EXPECT_EQ(root.text(), "x = 1 # one\n");
  EXPECT_EQ(root.source(), file.string());
}

TEST(TomlTable, ThrowsASystemErrorForFilesThatCannotBeRead) {
  EXPECT_THROW(static_cast<void>(TomlTable::read_file("/nowhere/f.toml")), std::system_error);
  EXPECT_THROW(static_cast<void>(TomlTable::read_file("/")), std::system_error);
}

TEST(NearestName, FindsSlipsOfThePenOnly) {
  const std::vector<std::string> names = {"sample_time_s", "settle", "u1"};
  EXPECT_EQ(nearest_name("sampel_time_s", names), "sample_time_s");
  EXPECT_EQ(nearest_name("setle", names), "settle");
  EXPECT_EQ(nearest_name("u2", names), "u1");
  EXPECT_EQ(nearest_name("threshold", names), std::nullopt);
}

}  // namespace
}  // namespace faultline

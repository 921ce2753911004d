#include "diagnosis/bank/bank_file.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <limits>
#include <system_error>
#include <unordered_set>
#include <utility>

#include <unistd.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/bank/json_tree.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Bounds against hostile files, far above any plant: eigenvalues of one F of this order take about
// a second, and channels times order stay within the file's size anyway.
constexpr std::size_t kMaxOrder = 512;
constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{256} << 20;

constexpr std::array<std::pair<Sensitivity, std::string_view>, 3> kSensitivityNames = {{
    {Sensitivity::kNone, "none"},
    {Sensitivity::kTransient, "transient"},
    {Sensitivity::kSteady, "steady"},
}};

// ---------------------------------------------------------------------------------- writing

std::string name_list(const std::vector<std::string>& names) {
  std::vector<std::string> quoted;
  for (const std::string& name : names) {
    quoted.push_back(json_string(name));
  }
  return fmt::format("[{}]", fmt::join(quoted, ", "));
}

template <class Numbers>
std::string number_list(const Numbers& numbers) {
  std::vector<std::string> texts;
  for (const double number : numbers) {
    assert(std::isfinite(number));
    texts.push_back(json_number(number));
  }
  return fmt::format("[{}]", fmt::join(texts, ", "));
}

// One row per line, at `indent` spaces.
std::string matrix_text(const MatrixXd& matrix, int indent) {
  std::vector<std::string> rows;
  for (Index i = 0; i < matrix.rows(); ++i) {
    rows.push_back(number_list(Eigen::VectorXd(matrix.row(i))));
  }
  return fmt::format("[{}]", fmt::join(rows, fmt::format(",\n{:{}}", "", indent)));
}

std::vector<std::string> fault_names(const Bank& bank, const std::vector<std::size_t>& faults) {
  std::vector<std::string> names;
  for (const std::size_t j : faults) {
    names.push_back(bank.fault_names[j]);
  }
  return names;
}

std::vector<std::string> sensitivity_names(const std::vector<Sensitivity>& sees) {
  std::vector<std::string> names;
  for (const Sensitivity sensitivity : sees) {
    names.emplace_back(kSensitivityNames[static_cast<std::size_t>(sensitivity)].second);
  }
  return names;
}

std::string certificate_text(const FilterCertificate& certificate) {
  std::string text = "{\n";
  text +=
      fmt::format("        \"spectral_radius\": {},\n", json_number(certificate.spectral_radius));
  text += fmt::format("        \"residual_MP_HC\": {},\n", json_number(certificate.residual_MP_HC));
  text += fmt::format("        \"residual_FP_PA_EC\": {},\n",
                      json_number(certificate.residual_FP_PA_EC));
  text += fmt::format("        \"leakage_decoupled\": {},\n",
                      json_number(certificate.leakage_decoupled));
  text += fmt::format("        \"dc_gain\": {},\n", number_list(certificate.dc_gain));
  text += fmt::format("        \"margin\": {}\n      }}", number_list(certificate.margin));
  return text;
}

std::string filter_text(const Bank& bank, const ResidualFilter& filter) {
  // Column of a matrix's second row: under its first.
  constexpr int kRowIndent = 12;
  std::string text = "    {\n";
  text += fmt::format("      \"name\": {},\n", json_string(filter.name));
  text += fmt::format("      \"ignores\": {},\n", name_list(fault_names(bank, filter.ignores)));
  text += fmt::format("      \"sees\": {},\n", name_list(sensitivity_names(filter.sees)));
  for (const auto& [letter, matrix] :
       {std::pair{'F', &filter.F}, std::pair{'E', &filter.E}, std::pair{'G', &filter.G},
        std::pair{'M', &filter.M}, std::pair{'H', &filter.H}, std::pair{'K', &filter.K}}) {
    text += fmt::format("      \"{}\": {},\n", letter, matrix_text(*matrix, kRowIndent));
  }
  text += fmt::format("      \"threshold\": {},\n", json_number(filter.threshold));
  text += fmt::format("      \"forget_samples\": {},\n", filter.forget_samples);
  text += fmt::format("      \"certificate\": {}\n    }}", certificate_text(filter.certificate));
  return text;
}

// ---------------------------------------------------------------------------------- reading

struct Text {
  std::string_view text;
  const std::string& source;
};

std::string describe(const JsonValue& value) {
  using Kind = JsonValue::Kind;
  switch (value.kind) {
    case Kind::kString:
      return fmt::format("string \"{}\"", value.text);
    case Kind::kArray:
      return fmt::format("a list of {} values", value.children.size());
    case Kind::kObject:
      return "an object";
    case Kind::kInteger:
    case Kind::kNumber:
      return "number " + value.text;
    case Kind::kNull:
    case Kind::kBoolean:
      break;
  }
  return value.text;
}

// One value of the file with its path ("filters[2].F"), read strictly.
class Cursor {
 public:
  Cursor(const Text& text, const JsonValue& value, std::string path)
      : text_(&text), value_(&value), path_(std::move(path)) {}

  [[nodiscard]] BankFileError error(const std::string& message) const {
    return error_at(value_->offset, path_, message);
  }
  [[nodiscard]] BankFileError expected(const std::string& what) const {
    return error(fmt::format("found {}, expected {}", describe(*value_), what));
  }

  // The object's values in the order of `keys`; all must be there, and nothing else.
  [[nodiscard]] std::vector<Cursor> members(std::initializer_list<std::string_view> keys) const {
    if (value_->kind != JsonValue::Kind::kObject) {
      throw expected("an object");
    }
    for (std::size_t i = 0; i < value_->keys.size(); ++i) {
      if (std::find(keys.begin(), keys.end(), value_->keys[i]) == keys.end()) {
        throw error_at(value_->key_offsets[i], path_,
                       fmt::format("found unknown key \"{}\", expected one of {}", value_->keys[i],
                                   fmt::join(keys, ", ")));
      }
    }
    std::vector<Cursor> found;
    for (const std::string_view key : keys) {
      const auto at = std::find(value_->keys.begin(), value_->keys.end(), key);
      if (at == value_->keys.end()) {
        throw error(fmt::format("found no \"{}\", expected it", key));
      }
      const auto index = static_cast<std::size_t>(at - value_->keys.begin());
      found.push_back(child(index, path_.empty() ? *at : path_ + "." + *at));
    }
    return found;
  }

  [[nodiscard]] std::vector<Cursor> elements() const {
    if (value_->kind != JsonValue::Kind::kArray) {
      throw expected("a list");
    }
    std::vector<Cursor> found;
    for (std::size_t i = 0; i < value_->children.size(); ++i) {
      found.push_back(child(i, fmt::format("{}[{}]", path_, i)));
    }
    return found;
  }
  [[nodiscard]] std::vector<Cursor> elements(std::size_t count) const {
    if (value_->kind == JsonValue::Kind::kArray && value_->children.size() != count) {
      throw expected(fmt::format("a list of {} values", count));
    }
    return elements();
  }

  [[nodiscard]] const std::string& string() const {
    if (value_->kind != JsonValue::Kind::kString) {
      throw expected("a string");
    }
    return value_->text;
  }

  [[nodiscard]] double number() const {
    const bool is_number =
        value_->kind == JsonValue::Kind::kNumber || value_->kind == JsonValue::Kind::kInteger;
    if (!is_number || !std::isfinite(value_->number)) {
      throw expected("a finite number");
    }
    return value_->number;
  }
  [[nodiscard]] double positive() const {
    if (const double value = number(); value > 0.0) {
      return value;
    }
    throw expected("a positive number");
  }
  [[nodiscard]] double not_negative() const {
    if (const double value = number(); value >= 0.0) {
      return value;
    }
    throw expected("a number that is not negative");
  }

  [[nodiscard]] std::uint32_t count(std::uint32_t smallest) const {
    constexpr double kLargest = std::numeric_limits<std::uint32_t>::max();
    if (value_->kind != JsonValue::Kind::kInteger || value_->number < smallest ||
        value_->number > kLargest) {
      throw expected(fmt::format("a whole number from {} to {}", smallest, kLargest));
    }
    return static_cast<std::uint32_t>(value_->number);
  }

  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> names;
    std::unordered_set<std::string> seen;
    for (const Cursor& element : elements()) {
      const std::string& name = element.string();
      if (name.empty() || !seen.insert(name).second) {
        throw element.expected("a name that was not there before");
      }
      names.push_back(name);
    }
    return names;
  }

  [[nodiscard]] Eigen::VectorXd vector(std::size_t size) const {
    Eigen::VectorXd vector(static_cast<Index>(size));
    Index i = 0;
    for (const Cursor& element : elements(size)) {
      vector[i++] = element.number();
    }
    return vector;
  }

  [[nodiscard]] MatrixXd matrix(std::size_t rows, std::size_t cols) const {
    MatrixXd matrix(static_cast<Index>(rows), static_cast<Index>(cols));
    Index i = 0;
    for (const Cursor& row : elements(rows)) {
      matrix.row(i++) = row.vector(cols);
    }
    return matrix;
  }

 private:
  [[nodiscard]] Cursor child(std::size_t index, std::string path) const {
    return {*text_, value_->children[index], std::move(path)};
  }
  [[nodiscard]] BankFileError error_at(std::size_t offset, const std::string& path,
                                       const std::string& message) const {
    const TextPosition at = text_position(text_->text, offset);
    return {text_->source, at.line, at.column, path.empty() ? message : path + ": " + message};
  }

  const Text* text_;
  const JsonValue* value_;
  std::string path_;
};

std::vector<double> to_std(const Eigen::VectorXd& vector) {
  return {vector.data(), vector.data() + vector.size()};
}

std::vector<std::size_t> read_ignored(const Cursor& list, const Bank& bank) {
  std::vector<std::size_t> ignores;
  for (const Cursor& element : list.elements()) {
    const auto found =
        std::find(bank.fault_names.begin(), bank.fault_names.end(), element.string());
    const auto j = static_cast<std::size_t>(found - bank.fault_names.begin());
    if (found == bank.fault_names.end() ||
        std::find(ignores.begin(), ignores.end(), j) != ignores.end()) {
      throw element.expected("the name of a fault, each once");
    }
    ignores.push_back(j);
  }
  return ignores;
}

std::vector<Sensitivity> read_sensitivities(const Cursor& list, std::size_t fault_count) {
  std::vector<Sensitivity> sees;
  for (const Cursor& element : list.elements(fault_count)) {
    const std::string& word = element.string();
    const auto* found = std::find_if(kSensitivityNames.begin(), kSensitivityNames.end(),
                                     [&](const auto& entry) { return entry.second == word; });
    if (found == kSensitivityNames.end()) {
      throw element.expected("\"none\", \"transient\" or \"steady\"");
    }
    sees.push_back(found->first);
  }
  return sees;
}

void refuse_contradiction(const Cursor& sees, const ResidualFilter& filter) {
  for (const std::size_t j : filter.ignores) {
    if (filter.sees[j] != Sensitivity::kNone) {
      throw sees.elements()[j].expected("\"none\" for an ignored fault");
    }
  }
}

FilterCertificate read_certificate(const Cursor& object, std::size_t fault_count) {
  const std::vector<Cursor> at =
      object.members({"spectral_radius", "residual_MP_HC", "residual_FP_PA_EC", "leakage_decoupled",
                      "dc_gain", "margin"});
  FilterCertificate certificate;
  certificate.spectral_radius = at[0].not_negative();
  certificate.residual_MP_HC = at[1].not_negative();
  certificate.residual_FP_PA_EC = at[2].not_negative();
  certificate.leakage_decoupled = at[3].not_negative();
  certificate.dc_gain = to_std(at[4].vector(fault_count));
  certificate.margin = to_std(at[5].vector(fault_count));
  return certificate;
}

void read_matrices(const std::vector<Cursor>& at, const Bank& bank, ResidualFilter& filter) {
  const std::size_t order = at[0].elements().size();
  if (order > kMaxOrder) {
    throw at[0].expected(fmt::format("at most {} rows", kMaxOrder));
  }
  const std::size_t rows = at[4].elements().size();
  if (rows == 0) {
    throw at[4].expected("at least one row");
  }
  const std::size_t m = bank.input_names.size();
  const std::size_t q = bank.output_names.size();
  filter.F = at[0].matrix(order, order);
  filter.E = at[1].matrix(order, q);
  filter.G = at[2].matrix(order, m);
  filter.M = at[3].matrix(rows, order);
  filter.H = at[4].matrix(rows, q);
  filter.K = at[5].matrix(rows, m);
  const double radius = spectral_radius(filter.F);
  if (!(radius < 1.0)) {
    throw at[0].error(
        fmt::format("found spectral radius {:.6g}, expected a stable filter (below 1)", radius));
  }
}

ResidualFilter read_filter(const Cursor& object, const Bank& bank) {
  const std::vector<Cursor> at =
      object.members({"F", "E", "G", "M", "H", "K", "name", "ignores", "sees", "threshold",
                      "forget_samples", "certificate"});
  ResidualFilter filter;
  filter.name = at[6].string();
  filter.ignores = read_ignored(at[7], bank);
  filter.sees = read_sensitivities(at[8], bank.fault_names.size());
  refuse_contradiction(at[8], filter);
  read_matrices(at, bank, filter);
  filter.threshold = at[9].positive();
  filter.forget_samples = at[10].count(0);
  filter.certificate = read_certificate(at[11], bank.fault_names.size());
  return filter;
}

void refuse_large_decision_table(const Cursor& concurrent, const Bank& bank,
                                 std::size_t filter_count) {
  const std::size_t words = filter_count / 64 + 1;
  if (fault_set_count(bank.fault_names.size(), bank.concurrent) > kMaxDecisionWords / words) {
    throw concurrent.error(fmt::format(
        "found {} of {} faults with {} filters, expected a decision table of at most {} "
        "words",
        bank.concurrent, bank.fault_names.size(), filter_count, kMaxDecisionWords));
  }
}

void read_filters(const Cursor& list, Bank& bank) {
  std::unordered_set<std::string> names;
  for (const Cursor& element : list.elements()) {
    bank.filters.push_back(read_filter(element, bank));
    const std::string& name = bank.filters.back().name;
    if (!names.insert(name).second) {
      throw element.error(
          fmt::format("found a second filter \"{}\", expected different names", name));
    }
  }
}

void read_channels(const std::vector<Cursor>& at, Bank& bank) {
  bank.input_names = at[0].names();
  bank.output_names = at[1].names();
  bank.fault_names = at[2].names();
  for (const Cursor& size : at[3].elements(bank.fault_names.size())) {
    bank.fault_sizes.push_back(size.positive());
  }
  const std::vector<Cursor> point = at[4].members({"u", "y"});
  bank.u_operating = point[0].vector(bank.input_names.size());
  bank.y_operating = point[1].vector(bank.output_names.size());
}

Bank read_tree(const Cursor& root) {
  const std::vector<Cursor> at = root.members(
      {"inputs", "outputs", "faults", "fault_sizes", "operating_point", "schema", "name", "method",
       "plant", "request_digest", "sample_time_s", "concurrent", "decision", "filters"});
  Bank bank;
  if (at[5].count(0) != 1) {
    throw at[5].expected("1");
  }
  read_channels(at, bank);
  bank.name = at[6].string();
  bank.method = at[7].string();
  const std::vector<Cursor> plant = at[8].members({"name", "digest"});
  bank.plant_name = plant[0].string();
  bank.plant_digest = plant[1].string();
  bank.request_digest = at[9].string();
  bank.sample_time_s = at[10].positive();
  bank.concurrent = at[11].count(1);
  refuse_large_decision_table(at[11], bank, at[13].elements().size());
  const std::vector<Cursor> decision = at[12].members({"dwell", "settle"});
  bank.decision = {decision[0].count(1), decision[1].count(1)};
  read_filters(at[13], bank);
  return bank;
}

std::string located(const std::string& source, int line, int column, const std::string& text) {
  return line == 0 ? fmt::format("{}: {}", source, text)
                   : fmt::format("{}:{}:{}: {}", source, line, column, text);
}

[[noreturn]] void throw_system_error(const std::filesystem::path& file) {
  throw std::system_error(errno != 0 ? errno : EIO, std::generic_category(), file.string());
}

}  // namespace

BankFileError::BankFileError(const std::string& source, int line, int column,
                             const std::string& text)
    : std::runtime_error(located(source, line, column, text)),
      source_(source),
      line_(line),
      column_(column) {}

std::string bank_text(const Bank& bank) {
  std::vector<std::string> filters;
  for (const ResidualFilter& filter : bank.filters) {
    filters.push_back(filter_text(bank, filter));
  }
  std::string text = "{\n  \"schema\": 1,\n";
  text += fmt::format("  \"name\": {},\n", json_string(bank.name));
  text += fmt::format("  \"method\": {},\n", json_string(bank.method));
  text += fmt::format("  \"plant\": {{\"name\": {}, \"digest\": {}}},\n",
                      json_string(bank.plant_name), json_string(bank.plant_digest));
  text += fmt::format("  \"request_digest\": {},\n", json_string(bank.request_digest));
  text += fmt::format("  \"sample_time_s\": {},\n", json_number(bank.sample_time_s));
  text += fmt::format("  \"concurrent\": {},\n", bank.concurrent);
  text += fmt::format("  \"inputs\": {},\n", name_list(bank.input_names));
  text += fmt::format("  \"outputs\": {},\n", name_list(bank.output_names));
  text += fmt::format("  \"faults\": {},\n", name_list(bank.fault_names));
  text += fmt::format("  \"fault_sizes\": {},\n", number_list(bank.fault_sizes));
  text += fmt::format("  \"operating_point\": {{\"u\": {}, \"y\": {}}},\n",
                      number_list(bank.u_operating), number_list(bank.y_operating));
  text += fmt::format("  \"decision\": {{\"dwell\": {}, \"settle\": {}}},\n", bank.decision.dwell,
                      bank.decision.settle);
  text += fmt::format("  \"filters\": [\n{}\n  ]\n}}\n", fmt::join(filters, ",\n"));
  return text;
}

void write_bank(const Bank& bank, const std::filesystem::path& file) {
  const std::string text = bank_text(bank);
  std::filesystem::path temporary = file;
  temporary += fmt::format(".{}.tmp", ::getpid());
  errno = 0;
  std::ofstream stream(temporary, std::ios::binary);
  stream << text;
  stream.close();
  std::error_code cause;
  if (!stream) {
    cause.assign(errno != 0 ? errno : EIO, std::generic_category());
  } else {
    std::filesystem::rename(temporary, file, cause);
  }
  if (cause) {
    std::error_code ignored;
    std::filesystem::remove(temporary, ignored);
    throw std::system_error(cause, file.string());
  }
}

Bank read_bank(const std::filesystem::path& file) {
  errno = 0;
  std::ifstream stream(file, std::ios::binary);
  if (!stream.is_open() || std::filesystem::is_directory(file)) {
    throw_system_error(file);
  }
  if (std::error_code no_size;
      std::filesystem::file_size(file, no_size) > kMaxFileBytes && !no_size) {
    throw BankFileError(file.string(), 0, 0,
                        fmt::format("found more than {} bytes, expected a bank", kMaxFileBytes));
  }
  const std::string text(std::istreambuf_iterator<char>(stream), {});
  if (stream.bad()) {
    throw_system_error(file);
  }
  return parse_bank(text, file.string());
}

Bank parse_bank(std::string_view text, const std::string& source) {
  const JsonValue tree = parse_json(text, source);
  const Text origin{text, source};
  return read_tree(Cursor(origin, tree, ""));
}

}  // namespace faultline

#include "tools/bench/diagnosis_inputs.h"

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/design/bank_request.h"
#include "drivers/dbc/dbc_parser.h"
#include "tools/bench/bank_cache.h"
#include "tools/bench/bench_inputs.h"

namespace faultline {

RunPart read_part(const char* part, const std::filesystem::path& file) {
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  if (!in || std::filesystem::is_directory(file)) {
    throw std::system_error(in ? EISDIR : errno, std::generic_category(),
                            "cannot read " + file.string());
  }
  return {part, file.filename().string(),
          std::string(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>())};
}

const RunPart* find_part(const std::vector<RunPart>& parts, std::string_view part) noexcept {
  const auto found = std::find_if(parts.begin(), parts.end(),
                                  [&](const RunPart& known) { return known.part == part; });
  return found == parts.end() ? nullptr : &*found;
}

std::vector<std::string> warnings_of(const DbcDatabase& dbc) {
  std::vector<std::string> texts;
  for (const DbcWarning& warning : dbc.warnings) {
    if (warning.severity != DbcSeverity::kWarning) continue;
    texts.push_back(fmt::format("{}:{}:{}: {}", dbc.source, warning.position.line,
                                warning.position.column, warning.text));
  }
  return texts;
}

DbcDatabase parse_whole_dbc(std::string_view text, const std::string& source) {
  DbcDatabase dbc = parse_dbc(text, source);
  for (const DbcWarning& warning : dbc.warnings) {
    if (warning.severity == DbcSeverity::kError) {
      throw DbcError(dbc.source, warning.position, warning.text);
    }
  }
  return dbc;
}

Bank load_bank_file(const std::filesystem::path& file) {
  if (file.extension() == ".json") return read_bank(file);
  const BankRequest request = read_bank_request(file);
  return cached_design(read_requested_plant(request), request);
}

DiagnosisInputs make_diagnosis_inputs(Bank bank, const RunPart& dbc, const std::string& source,
                                      const ChannelMappings& mappings) {
  const DbcDatabase database = parse_whole_dbc(dbc.text, source);
  DiagnosisInputs inputs;
  inputs.name = bank.name;
  inputs.map = make_signal_map(database, bank.output_names, bank.input_names, mappings);
  inputs.parts = {dbc, {"bank", bank.name + ".bank.json", bank_text(bank)}};
  inputs.dbc_warnings = warnings_of(database);
  inputs.bank = std::move(bank);
  return inputs;
}

}  // namespace faultline

#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "diagnosis/bank/bank.h"
#include "drivers/dbc/dbc_database.h"
#include "drivers/signal/signal_map.h"
#include "tools/lcm/run_parts.h"

namespace faultline {

/// Everything the diagnosis needs, read, checked and fitted together.
struct DiagnosisInputs {
  std::string name;  ///< of the scenario, or of the bank where there is none
  Bank bank;
  SignalMap map;
  bool is_initial_state_known = false;    ///< the bank need not forget its start
  std::vector<RunPart> parts;             ///< what it was made from
  std::vector<std::string> dbc_warnings;  ///< "file:line:column: ..."
};

using ChannelMappings = std::map<std::string, ChannelMapping, std::less<>>;

/// What a bank and a DBC give. A channel's signal bears its name unless `mappings` says another.
/// @param source name of the DBC for messages
/// @throws DbcError, SignalMapError the DBC is wrong, or does not carry the bank's channels.
[[nodiscard]] DiagnosisInputs make_diagnosis_inputs(Bank bank, const RunPart& dbc,
                                                    const std::string& source,
                                                    const ChannelMappings& mappings = {});

/// A bank from a file: *.json is read; a bank request (.toml) is designed first, as for a scenario.
/// @throws InputError, BankFileError, NotSolvable, std::system_error as load_bench_inputs.
[[nodiscard]] Bank load_bank_file(const std::filesystem::path& file);

/// The text of `file` as a part of a run. @throws std::system_error it cannot be read.
[[nodiscard]] RunPart read_part(const char* part, const std::filesystem::path& file);

/// The part of that name, or nullptr.
[[nodiscard]] const RunPart* find_part(const std::vector<RunPart>& parts,
                                       std::string_view part) noexcept;

/// The texts of a DBC whose every statement was understood: the bench trusts its DBC.
/// @throws DbcError one was not.
[[nodiscard]] DbcDatabase parse_whole_dbc(std::string_view text, const std::string& source);
/// What is odd in it: "file:line:column: ...".
[[nodiscard]] std::vector<std::string> warnings_of(const DbcDatabase& dbc);

}  // namespace faultline

#include "tools/error_answer.h"

#include <exception>
#include <stdexcept>
#include <system_error>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/input_error.h"
#include "drivers/can/can_bus.h"
#include "drivers/dbc/dbc_parser.h"
#include "drivers/signal/message_protection.h"
#include "drivers/signal/signal_map.h"
#include "tools/bench/bench_inputs.h"
#include "tools/campaign/campaign_database.h"
#include "tools/can/frame_log.h"
#include "tools/cli.h"
#include "tools/lcm/message_sink.h"

namespace faultline {

ErrorAnswer answer_current_exception() {
  try {
    throw;
  } catch (const NotSolvable& error) {
    return {error.what(), kExitNo};
  } catch (const InputError& error) {
    return {error.what(), kExitBadInput};
  } catch (const DbcError& error) {
    return {error.what(), kExitBadInput};
  } catch (const BankFileError& error) {
    return {error.what(), kExitBadInput};
  } catch (const SignalMapError& error) {
    return {error.what(), kExitBadInput};
  } catch (const ProtectionError& error) {
    return {error.what(), kExitBadInput};
  } catch (const FrameLogError& error) {
    return {error.what(), kExitBadInput};
  } catch (const BusError& error) {
    return {error.what(), kExitFailure};
  } catch (const MessageSinkError& error) {
    return {error.what(), kExitFailure};
  } catch (const DatabaseError& error) {
    return {error.what(), kExitFailure};
  } catch (const OutputError& error) {
    return {error.what(), kExitFailure};
  } catch (const std::system_error& error) {
    // An input file that is not there is the user's slip; one that the system fails to read is not.
    const bool is_missing = error.code() == std::errc::no_such_file_or_directory ||
                            error.code() == std::errc::is_a_directory ||
                            error.code() == std::errc::not_a_directory;
    return {error.what(), is_missing ? kExitBadInput : kExitFailure};
  } catch (const std::invalid_argument& error) {
    return {error.what(), kExitBadInput};
  } catch (const std::exception& error) {
    return {error.what(), kExitFailure};
  }
}

}  // namespace faultline

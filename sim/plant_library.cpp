#include "sim/plant_library.h"

#include <cmath>
#include <exception>
#include <set>
#include <span>
#include <string>
#include <system_error>

#include <dlfcn.h>

#include <fmt/format.h>

namespace faultline {
namespace {

struct Signals {
  const char* what;
  const faultline_plant_signal* signals;
  std::size_t count;
  bool is_required, must_have_size;
};

void check_signals(const Signals& list) {
  if (list.count == 0 && list.is_required) {
    throw PlantLibraryError(fmt::format("{}: found none, expected at least one", list.what));
  }
  if (list.count > 0 && list.signals == nullptr) {
    throw PlantLibraryError(
        fmt::format("{}: found a null pointer, expected {} of them", list.what, list.count));
  }
  std::set<std::string> names;
  for (const faultline_plant_signal& signal : std::span(list.signals, list.count)) {
    if (signal.name == nullptr || *signal.name == '\0') {
      throw PlantLibraryError(
          fmt::format("{}: found no name at place {}, expected one", list.what, names.size() + 1));
    }
    if (!names.insert(signal.name).second) {
      throw PlantLibraryError(
          fmt::format("{}: found \"{}\" twice, expected different names", list.what, signal.name));
    }
    if (!std::isfinite(signal.nominal) || !std::isfinite(signal.size)) {
      throw PlantLibraryError(
          fmt::format("{}: found nominal {} and size {} of \"{}\", expected finite numbers",
                      list.what, signal.nominal, signal.size, signal.name));
    }
    if (signal.size < 0.0 || (list.must_have_size && signal.size == 0.0)) {
      throw PlantLibraryError(
          fmt::format("{}: found size {} of \"{}\", expected {}", list.what, signal.size,
                      signal.name, list.must_have_size ? "a positive number" : "zero or more"));
    }
  }
}

void require_pointer(bool is_there, const char* what) {
  if (is_there) return;
  throw PlantLibraryError(fmt::format("{}: found a null pointer, expected one to it", what));
}

}  // namespace

void check_plant_table(const faultline_plant_table& table) {
  if (table.version != FAULTLINE_PLANT_VERSION) {
    throw PlantLibraryError(
        fmt::format("version: found {}, expected {}", table.version, FAULTLINE_PLANT_VERSION));
  }
  if (table.size != sizeof(faultline_plant_table)) {
    throw PlantLibraryError(
        fmt::format("size: found {} bytes, expected {}: the table was built "
                    "from another plant_table.h",
                    table.size, sizeof(faultline_plant_table)));
  }
  require_pointer(table.name != nullptr && *table.name != '\0', "name");
  require_pointer(table.description != nullptr, "description");
  require_pointer(table.source != nullptr, "source");
  check_signals({"states", table.states, table.state_count, true, true});
  check_signals({"inputs", table.inputs, table.input_count, true, true});
  check_signals({"outputs", table.outputs, table.output_count, true, true});
  check_signals({"parameters", table.parameters, table.parameter_count, false, false});
  check_signals({"disturbances", table.disturbances, table.disturbance_count, false, false});
  require_pointer(table.derivative != nullptr, "derivative");
  require_pointer(table.measure != nullptr, "measure");
  if (table.event_count > 0) {
    require_pointer(table.events != nullptr, "events");
    require_pointer(table.on_event != nullptr, "on_event");
  }
}

std::shared_ptr<const faultline_plant_table> load_plant_library(
    const std::filesystem::path& library) {
  std::error_code error;
  // dlopen looks a bare name up along the system's folders, and an absolute one nowhere else.
  const std::filesystem::path file = std::filesystem::absolute(library, error);
  if (!std::filesystem::is_regular_file(file, error)) {
    throw PlantLibraryError(
        fmt::format("{}: found no file, expected a shared library", library.string()));
  }
  const std::shared_ptr<void> handle(::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL),
                                     [](void* loaded) {
                                       if (loaded != nullptr) ::dlclose(loaded);
                                     });
  if (!handle) {
    throw PlantLibraryError(fmt::format("{}: cannot be loaded, expected a shared library: {}",
                                        library.string(), ::dlerror()));
  }
  void* const symbol = ::dlsym(handle.get(), FAULTLINE_PLANT_ENTRY);
  if (symbol == nullptr) {
    throw PlantLibraryError(
        fmt::format("{}: found no function {}, expected it: FAULTLINE_PLANT "
                    "(sim/plant_equations.h) makes it",
                    library.string(), FAULTLINE_PLANT_ENTRY));
  }
  const auto entry = reinterpret_cast<const faultline_plant_table* (*)()>(symbol);
  const faultline_plant_table* const table = [&] {
    try {
      return entry();
    } catch (const std::exception& exception) {
      throw PlantLibraryError(fmt::format("{}: {} has thrown \"{}\", expected a table",
                                          library.string(), FAULTLINE_PLANT_ENTRY,
                                          exception.what()));
    } catch (...) {
      throw PlantLibraryError(fmt::format("{}: {} has thrown an exception, expected a table",
                                          library.string(), FAULTLINE_PLANT_ENTRY));
    }
  }();
  if (table == nullptr) {
    throw PlantLibraryError(fmt::format("{}: {} returned a null pointer, expected a table",
                                        library.string(), FAULTLINE_PLANT_ENTRY));
  }
  try {
    check_plant_table(*table);
  } catch (const PlantLibraryError& wrong) {
    throw PlantLibraryError(fmt::format("{}: {}", library.string(), wrong.what()));
  }
  return {handle, table};
}

}  // namespace faultline

#include "tools/campaign/rank_link.h"

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <vector>

#include <dlfcn.h>

#include <fmt/format.h>

#include "tools/campaign/mpi_module.h"

namespace faultline {
namespace {

/// Set by Open MPI, by MPICH and its kin, and by Slurm's own starter.
bool is_started_by_mpi() {
  for (const char* const name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK"}) {
    if (std::getenv(name) != nullptr) return true;
  }
  return false;
}

/// Beside the program in a build, in the library folder where it is installed.
std::vector<std::filesystem::path> module_files() {
  std::error_code error;
  const std::filesystem::path program =
      std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  return {program / kMpiModuleFile,
          program.parent_path() / FAULTLINE_LIBDIR / "faultline" / kMpiModuleFile};
}

}  // namespace

struct RankLink::Module {
  void* handle = nullptr;
  const MpiModule* table = nullptr;
  bool is_closed = false;
};

RankLink::RankLink() : module_(std::make_unique<Module>()) {
  for (const std::filesystem::path& file : module_files()) {
    if (!std::filesystem::exists(file)) continue;
    module_->handle = ::dlopen(file.c_str(), RTLD_NOW | RTLD_GLOBAL);
    if (module_->handle == nullptr) {
      throw std::runtime_error(fmt::format("MPI: cannot load {}: {}", file.string(), ::dlerror()));
    }
    break;
  }
  if (module_->handle == nullptr) {
    throw std::runtime_error(
        "MPI: found mpirun, but no module faultline_mpi.so beside the program: it was built "
        "without MPI; install libopenmpi-dev and build again, or use --shard");
  }
  module_->table = static_cast<const MpiModule*>(::dlsym(module_->handle, kMpiModuleSymbol));
  if (module_->table == nullptr || module_->table->version != kMpiModuleVersion) {
    throw std::runtime_error("MPI: found a faultline_mpi.so of another version of the program");
  }
  if (module_->table->start(&rank_, &size_) != 0) {
    throw std::runtime_error("MPI: cannot be started");
  }
}

RankLink::~RankLink() {
  // The module stays loaded: MPI leaves handlers behind that the process's end still calls.
  if (module_->table != nullptr && !module_->is_closed) module_->table->abort(1);
}

std::unique_ptr<RankLink> RankLink::open() {
  if (!is_started_by_mpi()) return nullptr;
  std::unique_ptr<RankLink> link(new RankLink);
  if (link->size() > 1) return link;
  link->close();
  return nullptr;
}

void RankLink::send(int to, const std::string& text) {
  module_->table->send(to, text.data(), text.size());
}

std::optional<RankMessage> RankLink::receive() {
  int from = 0;
  std::size_t size = 0;
  if (module_->table->probe(&from, &size) == 0) return std::nullopt;
  RankMessage message{from, std::string(size, '\0')};
  module_->table->receive(from, message.text.data(), size);
  return message;
}

void RankLink::close() {
  module_->is_closed = true;
  module_->table->finish();
}

}  // namespace faultline

#pragma once

#include <cstddef>

namespace faultline {

inline constexpr char kMpiModuleFile[] = "faultline_mpi.so";
inline constexpr char kMpiModuleSymbol[] = "faultline_mpi_module";
inline constexpr int kMpiModuleVersion = 1;

/// What the module faultline_mpi.so gives: byte strings between ranks, from one thread. MPI's own
/// answer to an error is to end all ranks.
struct MpiModule {
  int version;
  int (*start)(int* rank, int* size);                        ///< 0: MPI runs
  void (*send)(int to, const char* data, std::size_t size);  ///< copies; does not wait
  int (*probe)(int* from, std::size_t* size);  ///< 1: a message is here; does not wait
  void (*receive)(int from, char* data, std::size_t size);
  void (*finish)();
  void (*abort)(int exit_code);
};

}  // namespace faultline

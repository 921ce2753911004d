#include "tools/campaign/mpi_module.h"

#include <mpi.h>

namespace faultline {
namespace {

int start(int* rank, int* size) {
  int provided = 0;
  if (MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided) != MPI_SUCCESS) return 1;
  if (provided < MPI_THREAD_FUNNELED) return 1;
  MPI_Comm_rank(MPI_COMM_WORLD, rank);
  MPI_Comm_size(MPI_COMM_WORLD, size);
  return 0;
}

void send(int to, const char* data, std::size_t size) {
  MPI_Send(data, static_cast<int>(size), MPI_CHAR, to, 0, MPI_COMM_WORLD);
}

int probe(int* from, std::size_t* size) {
  int is_here = 0, count = 0;
  MPI_Status status;
  MPI_Iprobe(MPI_ANY_SOURCE, 0, MPI_COMM_WORLD, &is_here, &status);
  if (is_here == 0) return 0;
  MPI_Get_count(&status, MPI_CHAR, &count);
  *from = status.MPI_SOURCE;
  *size = static_cast<std::size_t>(count);
  return 1;
}

void receive(int from, char* data, std::size_t size) {
  MPI_Recv(data, static_cast<int>(size), MPI_CHAR, from, 0, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
}

void finish() { MPI_Finalize(); }

void abort(int exit_code) { MPI_Abort(MPI_COMM_WORLD, exit_code); }

}  // namespace
}  // namespace faultline

// NOLINTNEXTLINE(readability-identifier-naming): found by its name
extern "C" const faultline::MpiModule faultline_mpi_module{
    faultline::kMpiModuleVersion, faultline::start,  faultline::send,  faultline::probe,
    faultline::receive,           faultline::finish, faultline::abort,
};

#include "tools/campaign/mpi_module.h"

#include <list>
#include <string>

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

/// A message on its way. A blocking send of more than a few kB spins until the other side receives:
/// of two ranks on two cores that took 5 % of the time of the runs.
struct Outgoing {
  std::string text;
  MPI_Request request = MPI_REQUEST_NULL;
};

std::list<Outgoing>& outgoing() {
  static std::list<Outgoing> messages;
  return messages;
}

void send(int to, const char* data, std::size_t size) {
  Outgoing& message = outgoing().emplace_back(Outgoing{.text = std::string(data, size)});
  MPI_Isend(message.text.data(), static_cast<int>(size), MPI_CHAR, to, 0, MPI_COMM_WORLD,
            &message.request);
}

int probe(int* from, std::size_t* size) {
  int is_here = 0, count = 0;
  MPI_Status status;
  outgoing().remove_if([](Outgoing& message) {
    int is_sent = 0;
    MPI_Test(&message.request, &is_sent, MPI_STATUS_IGNORE);
    return is_sent != 0;
  });
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

void finish() {
  for (Outgoing& message : outgoing()) MPI_Wait(&message.request, MPI_STATUS_IGNORE);
  outgoing().clear();
  MPI_Finalize();
}

void abort(int exit_code) { MPI_Abort(MPI_COMM_WORLD, exit_code); }

}  // namespace
}  // namespace faultline

// NOLINTNEXTLINE(readability-identifier-naming): found by its name
extern "C" const faultline::MpiModule faultline_mpi_module{
    faultline::kMpiModuleVersion, faultline::start,  faultline::send,  faultline::probe,
    faultline::receive,           faultline::finish, faultline::abort,
};

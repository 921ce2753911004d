#include "tools/bench/stop_signal.h"

#include <csignal>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>

namespace faultline {

struct StopSignal::State {
  boost::asio::io_context context{1};
  boost::asio::signal_set signals{context, SIGINT, SIGTERM};
  int received = 0;
};

StopSignal::StopSignal() : state_(std::make_unique<State>()) {
  state_->signals.async_wait([this](const boost::system::error_code& error, int signal) {
    if (!error) state_->received = signal;
  });
}

StopSignal::~StopSignal() = default;

int StopSignal::poll() {
  state_->context.poll();
  return state_->received;
}

}  // namespace faultline

#include "drivers/can/bus_group.h"

#include <algorithm>
#include <cerrno>
#include <stdexcept>

#include <poll.h>

#include <sys/epoll.h>

#include "drivers/can/atomic_bus_counters.h"
#include "drivers/can/bus_socket.h"

namespace faultline {
namespace {

using std::chrono::nanoseconds;
using std::chrono::steady_clock;

/// Longest single wait of `receive`: keeps the deadline's arithmetic far from overflow.
constexpr std::chrono::hours kLongestWait{24};
/// A member that is down is asked this often whether it is back.
constexpr std::chrono::milliseconds kReturnPoll{10};

}  // namespace

struct BusGroup::State {
  /// What a member gave in one round: a stretch of `frames`, and how much of it has been merged.
  struct Share {
    std::size_t next = 0;
    std::size_t end = 0;
  };

  explicit State(std::vector<std::unique_ptr<CanBus>> buses);

  /// One round over the members that may have something. Leaves what they gave in `shares`.
  ReceiveResult read_round(std::size_t room) noexcept;
  /// Reads up to `most` frames of member `index` behind the last ones. @return as the member.
  ReceiveStatus read_member(std::size_t index, std::size_t most) noexcept;
  /// Moves the frames of a round to `out`, by stamp, those of one member in their order.
  void merge(std::span<CanFrame> out) noexcept;
  [[nodiscard]] bool is_any_up() const noexcept;
  [[nodiscard]] bool are_all_up() const noexcept;

  std::vector<std::unique_ptr<CanBus>> members;
  Socket epoll;
  AtomicBusCounters own_counters;  ///< of frames that name no member
  // Used by the receiving thread.
  std::vector<pollfd> readiness;
  std::vector<CanFrame> frames;
  std::vector<Share> shares;
  std::size_t frame_count = 0;
  std::size_t first = 0;  ///< the member whose turn it is to be read first
  bool is_down_reported = false;
};

BusGroup::State::State(std::vector<std::unique_ptr<CanBus>> buses)
    : members(std::move(buses)), epoll(::epoll_create1(EPOLL_CLOEXEC)) {
  if (members.empty() || members.size() > kMostMembers) {
    throw std::invalid_argument("BusGroup: found " + std::to_string(members.size()) +
                                " members, expected 1 to " + std::to_string(kMostMembers));
  }
  if (epoll.fd() < 0) throw BusError("BusGroup: cannot make an epoll: " + errno_text(errno));
  for (const auto& member : members) {
    const int fd = member->readiness_fd();
    if (fd < 0) {
      throw std::invalid_argument("BusGroup: " + member->name() +
                                  " has no file descriptor to wait on");
    }
    epoll_event event{.events = EPOLLIN, .data = {.fd = fd}};
    if (::epoll_ctl(epoll.fd(), EPOLL_CTL_ADD, fd, &event) != 0) {
      throw BusError("BusGroup: cannot wait on " + member->name() + ": " + errno_text(errno));
    }
    readiness.push_back({fd, POLLIN, 0});
  }
  frames.resize(kBatch);
  shares.resize(members.size());
}

ReceiveStatus BusGroup::State::read_member(std::size_t index, std::size_t most) noexcept {
  const std::size_t room = std::min(most, frames.size() - frame_count);
  const ReceiveResult result =
      members[index]->receive(std::span(frames).subspan(frame_count, room), nanoseconds::zero());
  shares[index] = {frame_count, frame_count + result.count};
  for (std::size_t n = 0; n < result.count; ++n) {
    frames[frame_count + n].bus = static_cast<std::uint8_t>(index);
  }
  frame_count += result.count;
  return result.status;
}

ReceiveResult BusGroup::State::read_round(std::size_t room) noexcept {
  frame_count = 0;
  std::fill(shares.begin(), shares.end(), Share{});
  const auto is_due = [this](std::size_t index) {
    return readiness[index].revents != 0 || !members[index]->is_up();
  };
  std::size_t due = 0;
  for (std::size_t n = 0; n < members.size(); ++n) due += is_due(n) ? 1u : 0u;
  bool has_failed = false;
  const std::size_t count = members.size();
  for (std::size_t n = 0; n < count && due > 0 && frame_count < room; ++n) {
    const std::size_t index = (first + n) % count;
    if (!is_due(index)) continue;
    // What one does not use, the next may.
    const std::size_t share = std::max<std::size_t>((room - frame_count) / due, 1);
    --due;
    if (read_member(index, share) == ReceiveStatus::kError) has_failed = true;
  }
  if (++first >= count) first = 0;
  if (frame_count > 0) return {ReceiveStatus::kOk, frame_count};
  return {has_failed ? ReceiveStatus::kError : ReceiveStatus::kTimeout, 0};
}

void BusGroup::State::merge(std::span<CanFrame> out) noexcept {
  for (std::size_t n = 0; n < frame_count; ++n) {
    Share* oldest = nullptr;
    for (Share& share : shares) {
      if (share.next == share.end) continue;
      if (oldest == nullptr || frames[share.next].stamp < frames[oldest->next].stamp) {
        oldest = &share;
      }
    }
    out[n] = frames[oldest->next++];
  }
}

bool BusGroup::State::is_any_up() const noexcept {
  return std::any_of(members.begin(), members.end(), [](const auto& bus) { return bus->is_up(); });
}

bool BusGroup::State::are_all_up() const noexcept {
  return std::all_of(members.begin(), members.end(), [](const auto& bus) { return bus->is_up(); });
}

BusGroup::BusGroup(std::vector<std::unique_ptr<CanBus>> members)
    : state_(std::make_unique<State>(std::move(members))) {}

BusGroup::~BusGroup() = default;

bool BusGroup::send(const CanFrame& frame) noexcept { return send_batch({&frame, 1}) == 1; }

std::size_t BusGroup::send_batch(std::span<const CanFrame> frames) noexcept {
  State& state = *state_;
  std::size_t taken = 0;
  for (std::size_t begin = 0; begin < frames.size();) {
    const std::size_t bus = frames[begin].bus;
    std::size_t end = begin + 1;
    while (end < frames.size() && frames[end].bus == bus) ++end;
    if (bus < state.members.size()) {
      taken += state.members[bus]->send_batch(frames.subspan(begin, end - begin));
    } else {
      state.own_counters.send_errors.add(end - begin);
    }
    begin = end;
  }
  return taken;
}

ReceiveResult BusGroup::receive(std::span<CanFrame> out, nanoseconds timeout) noexcept {
  State& state = *state_;
  if (out.empty()) return {};
  const std::size_t room = std::min(out.size(), kBatch);
  nanoseconds left = std::clamp<nanoseconds>(timeout, nanoseconds::zero(), kLongestWait);
  const auto deadline = steady_clock::now() + left;
  for (;;) {
    const bool must_ask = !state.are_all_up();
    const nanoseconds wait = must_ask ? std::min<nanoseconds>(left, kReturnPoll) : left;
    const timespec limit{static_cast<std::time_t>(wait / std::chrono::seconds(1)),
                         static_cast<long>((wait % std::chrono::seconds(1)).count())};
    const int ready = ::ppoll(state.readiness.data(), state.readiness.size(), &limit, nullptr);
    if (ready < 0) {
      if (errno != EINTR) return {ReceiveStatus::kError, 0};
      for (pollfd& fd : state.readiness) fd.revents = 0;
    }
    const ReceiveResult result = state.read_round(room);
    if (result.count > 0) state.merge(out);
    if (state.is_any_up()) {
      state.is_down_reported = false;
    } else if (!state.is_down_reported && result.count == 0) {
      state.is_down_reported = true;
      return {ReceiveStatus::kDown, 0};
    }
    if (result.status != ReceiveStatus::kTimeout) return result;
    left = deadline - steady_clock::now();
    if (left <= nanoseconds::zero()) return {};
  }
}

void BusGroup::set_filters(std::span<const IdFilter> filters) {
  for (const auto& member : state_->members) member->set_filters(filters);
}

int BusGroup::readiness_fd() const noexcept { return state_->epoll.fd(); }

BusCounters BusGroup::counters() const noexcept {
  BusCounters sum = state_->own_counters.snapshot();
  for (const auto& member : state_->members) sum = sum + member->counters();
  return sum;
}

bool BusGroup::is_up() const noexcept { return state_->is_any_up(); }

int BusGroup::last_error() const noexcept {
  for (const auto& member : state_->members) {
    if (member->last_error() != 0) return member->last_error();
  }
  return 0;
}

std::string BusGroup::name() const {
  std::string names;
  for (const auto& member : state_->members) {
    if (!names.empty()) names += ',';
    names += member->name();
  }
  return names;
}

std::size_t BusGroup::size() const noexcept { return state_->members.size(); }
const CanBus& BusGroup::member(std::size_t index) const noexcept { return *state_->members[index]; }

}  // namespace faultline

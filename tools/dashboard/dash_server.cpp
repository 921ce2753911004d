#include "tools/dashboard/dash_server.h"

#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include <unistd.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "tools/dashboard/live_view.h"
#include "tools/dashboard/page_files.h"
#include "tools/dashboard/view_json.h"
#include "tools/dashboard/viewer_request.h"
#include "tools/lcm/channels.h"
#include "tools/lcm/lcm_url.h"
#include "tools/lcm/message_sink.h"

namespace faultline {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using Tcp = asio::ip::tcp;
using ErrorCode = beast::error_code;
using Request = http::request<http::string_body>;

/// 25 pictures a second look continuous.
constexpr std::chrono::milliseconds kFrame{40};
constexpr std::chrono::milliseconds kLcmWait{5};
/// For a request to come, and for an answer to be taken.
constexpr std::chrono::seconds kHttpPatience{10};
constexpr std::size_t kLongestHeader = 8192;
/// What the kernel keeps for a viewer that does not read; it doubles it. By itself it would keep
/// megabytes, minutes of old states.
constexpr int kSendBuffer = 32 * 1024;
/// Until the next try where no connection can be accepted: there are no descriptors left.
constexpr std::chrono::milliseconds kAcceptPause{100};
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src data:; frame-ancestors 'none'; base-uri 'none'";

std::string_view view_of(beast::string_view text) { return {text.data(), text.size()}; }

/// The view as messages for viewers, each made when the first of them needs it.
class Picture {
 public:
  explicit Picture(const LiveView& view) : view_(view) {}

  [[nodiscard]] std::uint64_t revision() const noexcept { return view_.run_revision(); }
  const std::shared_ptr<const std::string>& run() {
    if (!run_) run_ = std::make_shared<const std::string>(run_json(view_));
    return run_;
  }
  const std::shared_ptr<const std::string>& state() {
    if (!state_) {
      state_ = std::make_shared<const std::string>(state_json(view_, LiveView::Clock::now()));
    }
    return state_;
  }

 private:
  const LiveView& view_;
  std::shared_ptr<const std::string> run_, state_;
};

}  // namespace

struct DashServer::State {
  class Session;

  explicit State(const DashOptions& options)
      : access{.token = options.token},
        source(options.lcm_url, "FAULTLINE_.*"),
        sink(open_live(options.lcm_url)) {}

  std::string send(inject_t request);
  void broadcast();
  void accept();
  void admit(Tcp::socket socket);
  bool make_room();

  ViewerAccess access;
  LcmSource source;
  std::unique_ptr<MessageSink> sink;
  LiveView view;
  std::int64_t requests = 0;
  asio::io_context io{1};
  Tcp::acceptor acceptor{io};
  asio::steady_timer accept_pause{io};
  std::set<std::shared_ptr<Session>> viewers;
  std::deque<std::weak_ptr<Session>> newcomers;  ///< who may not have asked yet, the oldest first
  std::size_t connections = 0;
};

/// One connection: a request for a file, or a WebSocket.
class DashServer::State::Session : public std::enable_shared_from_this<Session> {
 public:
  Session(Tcp::socket socket, State& state) : state_(state), socket_(std::move(socket)) {
    ++state_.connections;
  }
  ~Session() { --state_.connections; }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void start() {
    parser_.emplace();
    parser_->header_limit(kLongestHeader);
    parser_->body_limit(kLongestRequest);
    socket_.expires_after(kHttpPatience);
    http::async_read(socket_, buffer_, *parser_,
                     [self = shared_from_this()](ErrorCode error, std::size_t) {
                       if (!error) self->on_request();
                     });
  }

  /// The newest state, unless the last message is still under way.
  void offer(Picture& picture) {
    if (!is_open_ || is_writing_) return;
    if (answer_) {
      write(std::exchange(answer_, nullptr));
    } else if (revision_ != picture.revision()) {
      revision_ = picture.revision();
      write(picture.run());
    } else {
      write(picture.state());
    }
  }

  [[nodiscard]] bool has_asked() const noexcept { return has_asked_; }
  /// Its operations end with an error, and with them the session.
  void close() {
    ErrorCode ignored;
    socket_.socket().close(ignored);
  }

 private:
  void on_request() {
    has_asked_ = true;
    const Request& request = parser_->get();
    const std::string_view host = view_of(request[http::field::host]);
    const std::string_view target = view_of(request.target());
    const std::string_view path = target.substr(0, target.find('?'));
    if (!state_.access.admits_host(host)) {
      answer(http::status::forbidden, "text/plain",
             "This Host is not served: expected localhost or a numeric address, with the port.\n");
    } else if (websocket::is_upgrade(request)) {
      upgrade(host, target, path);
    } else if (request.method() != http::verb::get) {
      answer(http::status::method_not_allowed, "text/plain", "Expected GET.\n");
    } else if (const PageFile* const file = find_page_file(path); file == nullptr) {
      answer(http::status::not_found, "text/plain", "There is no such page.\n");
    } else if (file->is_page && !state_.access.admits_target(target)) {
      answer(http::status::unauthorized, "text/plain",
             "No token, or a wrong one: expected /?token=TOKEN, as faultline dash was given it.\n");
    } else {
      answer(http::status::ok, file->type, file->text);
    }
  }

  void answer(http::status status, std::string_view type, std::string_view text) {
    response_ = {status, 11};
    response_.set(http::field::content_type, beast::string_view(type.data(), type.size()));
    response_.set(http::field::cache_control, "no-store");
    response_.set("Content-Security-Policy", kPolicy);
    response_.set("X-Content-Type-Options", "nosniff");
    response_.set("Referrer-Policy", "no-referrer");
    response_.keep_alive(false);
    response_.body() = std::string(text);
    response_.prepare_payload();
    socket_.expires_after(kHttpPatience);
    http::async_write(socket_, response_, [self = shared_from_this()](ErrorCode, std::size_t) {
      ErrorCode ignored;
      self->socket_.socket().shutdown(Tcp::socket::shutdown_send, ignored);
    });
  }

  void upgrade(std::string_view host, std::string_view target, std::string_view path) {
    const std::string_view origin = view_of(parser_->get()[http::field::origin]);
    if (path != "/live") {
      answer(http::status::not_found, "text/plain", "The WebSocket is /live.\n");
    } else if (!ViewerAccess::admits_origin(origin, host)) {
      answer(http::status::forbidden, "text/plain", "This Origin is not served.\n");
    } else if (!state_.access.admits_target(target)) {
      answer(http::status::unauthorized, "text/plain", "No token, or a wrong one.\n");
    } else if (state_.viewers.size() >= kViewers) {
      answer(http::status::service_unavailable, "text/plain", "There are too many viewers.\n");
    } else {
      socket_.expires_never();
      socket_web_.emplace(std::move(socket_));
      socket_web_->set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
      socket_web_->read_message_max(kLongestRequest);
      socket_web_->auto_fragment(false);  // a state is one write, not one per 4 kB
      socket_web_->async_accept(parser_->get(), [self = shared_from_this()](ErrorCode error) {
        if (error) return;
        self->is_open_ = true;
        self->state_.viewers.insert(self);
        self->read();
      });
    }
  }

  void read() {
    buffer_.consume(buffer_.size());
    socket_web_->async_read(buffer_, [self = shared_from_this()](ErrorCode error, std::size_t) {
      if (error) return self->leave();
      self->on_message(beast::buffers_to_string(self->buffer_.data()));
    });
  }

  void on_message(const std::string& text) {
    nlohmann::json reply;
    try {
      reply = {{"type", "sent"}, {"request", state_.send(parse_viewer_request(text))}};
    } catch (const std::exception& error) {
      reply = {{"type", "refused"}, {"text", error.what()}};
    }
    answer_ = std::make_shared<const std::string>(
        reply.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    // The next is read when this is answered: one who floods waits for itself.
    is_read_due_ = true;
  }

  void write(std::shared_ptr<const std::string> text) {
    is_writing_ = true;
    const bool is_read_due = std::exchange(is_read_due_, is_read_due_ && answer_ != nullptr);
    const bool must_read = is_read_due && answer_ == nullptr;
    under_way_ = std::move(text);
    socket_web_->text(true);
    socket_web_->async_write(asio::buffer(*under_way_),
                             [self = shared_from_this(), must_read](ErrorCode error, std::size_t) {
                               self->is_writing_ = false;
                               if (error) return self->leave();
                               if (must_read) self->read();
                             });
  }

  void leave() {
    is_open_ = false;
    state_.viewers.erase(shared_from_this());
  }

  State& state_;
  beast::tcp_stream socket_;
  std::optional<websocket::stream<beast::tcp_stream>> socket_web_;
  beast::flat_buffer buffer_{kLongestHeader + kLongestRequest};
  std::optional<http::request_parser<http::string_body>> parser_;
  http::response<http::string_body> response_;
  std::shared_ptr<const std::string> under_way_, answer_;
  std::uint64_t revision_ = ~std::uint64_t{0};
  bool has_asked_ = false, is_open_ = false, is_writing_ = false, is_read_due_ = false;
};

std::string DashServer::State::send(inject_t request) {
  const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
  request.utime = std::chrono::duration_cast<std::chrono::microseconds>(since_1970).count();
  request.sequence = requests;
  request.request = fmt::format("dash-{}-{}", ::getpid(), requests++);
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(request.getEncodedSize()));
  request.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  sink->publish(kInjectChannel, request.utime, bytes);
  sink->flush();
  return request.request;
}

void DashServer::State::broadcast() {
  if (viewers.empty()) return view.reset_peaks();
  Picture picture(view);
  // A viewer that leaves changes the set.
  const std::vector<std::shared_ptr<Session>> all(viewers.begin(), viewers.end());
  for (const auto& viewer : all) viewer->offer(picture);
  view.reset_peaks();
}

void DashServer::State::accept() {
  acceptor.async_accept([this](ErrorCode error, Tcp::socket socket) {
    if (error == asio::error::operation_aborted) return;
    if (!error) {
      admit(std::move(socket));
      return accept();
    }
    // To try again at once would fail at once, for ever.
    accept_pause.expires_after(kAcceptPause);
    accept_pause.async_wait([this](ErrorCode stopped) {
      if (!stopped) accept();
    });
  });
}

void DashServer::State::admit(Tcp::socket socket) {
  std::erase_if(newcomers, [](const std::weak_ptr<Session>& one) {
    const auto session = one.lock();
    return !session || session->has_asked();
  });
  if (connections >= kConnections && !make_room()) return;
  ErrorCode ignored;  // without them it is served all the same
  socket.set_option(asio::socket_base::send_buffer_size(kSendBuffer), ignored);
  socket.set_option(Tcp::no_delay(true), ignored);
  const auto session = std::make_shared<Session>(std::move(socket), *this);
  newcomers.push_back(session);
  session->start();
}

/// False: everyone has asked for something.
bool DashServer::State::make_room() {
  if (newcomers.empty()) return false;
  const auto oldest = newcomers.front().lock();
  newcomers.pop_front();
  if (oldest) oldest->close();
  return true;
}

DashServer::DashServer(const DashOptions& options) {
  check_live_lcm_url(options.lcm_url);
  if (!options.listen.is_loopback() && options.token.empty()) {
    throw std::invalid_argument(
        fmt::format("--listen {}: others can reach this address, expected a --token with it",
                    options.listen.address));
  }
  state_ = std::make_unique<State>(options);
  const Tcp::endpoint endpoint(asio::ip::make_address(options.listen.address), options.listen.port);
  ErrorCode error;
  Tcp::acceptor& acceptor = state_->acceptor;
  acceptor.open(endpoint.protocol());
  acceptor.set_option(asio::socket_base::reuse_address(true));
  acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error) {
    throw std::runtime_error(
        fmt::format("cannot listen on {}:{}: {}; --listen ADDRESS:PORT takes another",
                    options.listen.address, options.listen.port, error.message()));
  }
  state_->access.port = acceptor.local_endpoint().port();
  state_->accept();
}

DashServer::~DashServer() = default;

std::uint16_t DashServer::port() const { return state_->access.port; }

void DashServer::run(const std::function<bool()>& should_stop) {
  auto next = LiveView::Clock::now();
  while (!should_stop()) {
    state_->source.receive(kLcmWait,
                           [&](const LiveMessage& message) { state_->view.take(message); });
    state_->io.poll();
    if (const auto now = LiveView::Clock::now(); now >= next) {
      state_->broadcast();
      next = now + kFrame;
    }
  }
}

}  // namespace faultline

#include "daemon/control/server.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>
#include <zmq.hpp>

#include "alhazen/caught.h"
#include "daemon/control/message.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kIpc = "ipc://", kTcp = "tcp://";

/// Requests answered in a row before anything else gets its turn.
constexpr int kMostInARow = 64;
/// Replies and events that may wait for one reader.
constexpr int kHighWater = 10'000;
/// Longer messages end the connection; between kLargestMessage and this they are answered with
/// `invalid`, so that an honest client learns why.
constexpr std::int64_t kCutMessage = std::int64_t{16} << 20;

Error system_error(const std::string& what) {
  return {Code::unavailable, what + ": " + std::strerror(errno)};
}

/// Whether somebody accepts connections at this socket file.
bool is_listened_at(const fs::path& file) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string path = file.string();
  if (path.size() >= sizeof address.sun_path) return false;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (probe < 0) return false;
  const int connected = connect(probe, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  // A full backlog (EAGAIN) means a listener, too.
  const bool listened = connected == 0 || errno == EAGAIN;
  close(probe);
  return listened;
}

/// Makes way for an ipc:// socket. libzmq would remove any file that is in its way, a living
/// daemon's socket, too: so what may go is judged here.
Status prepare_ipc(const fs::path& file) {
  constexpr std::size_t kLongestPath = sizeof(sockaddr_un::sun_path) - 1;
  if (!file.is_absolute() || file.string().size() > kLongestPath)
    return Error{Code::invalid, "'" + file.string() + "' must be an absolute path of at most " +
                                    std::to_string(kLongestPath) + " bytes"};
  const fs::path folder = file.parent_path();
  struct stat about {};
  if (stat(folder.c_str(), &about) != 0) {
    if (errno != ENOENT) return system_error("'" + folder.string() + "'");
    std::error_code error;
    fs::create_directories(folder.parent_path(), error);
    if (mkdir(folder.c_str(), 0750) != 0)
      return system_error("cannot make '" + folder.string() + "'");
    if (chmod(folder.c_str(), 0750) != 0) return system_error("'" + folder.string() + "'");
  } else if (!S_ISDIR(about.st_mode)) {
    return Error{Code::invalid, "'" + folder.string() + "' is no directory"};
  } else if ((about.st_mode & S_IWOTH) != 0) {
    return Error{Code::invalid, "others may write to '" + folder.string() +
                                    "'; the socket must lie in a directory of mode 0750"};
  }
  if (lstat(file.c_str(), &about) != 0) return {};
  if (!S_ISSOCK(about.st_mode))
    return Error{Code::invalid, "'" + file.string() + "' exists and is no socket"};
  if (is_listened_at(file))
    return Error{Code::conflict, "another daemon listens at '" + file.string() + "'"};
  if (about.st_uid != geteuid())
    return Error{Code::conflict, "'" + file.string() + "' is left over of another user's daemon"};
  if (unlink(file.c_str()) != 0) return system_error("cannot remove '" + file.string() + "'");
  return {};
}

bool is_loopback(std::string_view address) {
  return address.starts_with("127.0.0.1:") || address.starts_with("[::1]:") ||
         address.starts_with("localhost:");
}

Status prepare(const std::string& endpoint) {
  if (endpoint.starts_with(kIpc)) return prepare_ipc(endpoint.substr(kIpc.size()));
  if (!endpoint.starts_with(kTcp))
    return Error{Code::invalid, "it must begin with ipc:// or tcp://"};
  if (!is_loopback(std::string_view(endpoint).substr(kTcp.size())))
    return Error{Code::invalid,
                 "TCP off the loopback needs client keys, which this version does not have; it "
                 "must be 127.0.0.1, [::1] or localhost"};
  return {};
}

/// Binds; a socket file that was made is added to `files`.
Status bind(zmq::socket_t& socket, const std::string& endpoint, std::vector<std::string>& files) {
  ALHAZEN_TRY(prepare(endpoint));
  // The socket file for owner and group alone, whatever the umask says.
  const mode_t before = umask(0117);
  Status bound = caught(Code::unavailable, "cannot bind", [&] { socket.bind(endpoint); });
  umask(before);
  if (bound && endpoint.starts_with(kIpc)) files.push_back(endpoint.substr(kIpc.size()));
  return bound;
}

}  // namespace

struct Server::State {
  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  /// Takes the socket files away, which libzmq leaves; while they are still listened at, so that it
  /// cannot be the next daemon's that goes.
  ~State() {
    for (const std::string& file : files) unlink(file.c_str());
  }

  std::vector<std::string> files;
  zmq::context_t context{1};
  zmq::socket_t control{context, zmq::socket_type::router};
  zmq::socket_t events{context, zmq::socket_type::xpub};
  std::uint64_t dropped = 0, replies_lost = 0;
};

Server::Server(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
Server::~Server() = default;

Result<std::unique_ptr<Server>> Server::open(const std::string& control_endpoint,
                                             const std::string& event_endpoint) {
  return caught(Code::unavailable, "ZeroMQ", [&]() -> Result<std::unique_ptr<Server>> {
    auto state = std::make_unique<State>();
    state->control.set(zmq::sockopt::router_mandatory, true);
    state->control.set(zmq::sockopt::maxmsgsize, kCutMessage);
    state->control.set(zmq::sockopt::sndhwm, kHighWater);
    // A reply to a client that reads goes out within this; nobody else holds the daemon up.
    state->control.set(zmq::sockopt::linger, 200);
    state->events.set(zmq::sockopt::maxmsgsize, kCutMessage);
    state->events.set(zmq::sockopt::sndhwm, kHighWater);
    state->events.set(zmq::sockopt::linger, 200);
    ALHAZEN_TRY(bind(state->control, control_endpoint, state->files)
                    .in("control endpoint " + control_endpoint));
    ALHAZEN_TRY(
        bind(state->events, event_endpoint, state->files).in("event endpoint " + event_endpoint));
    return std::unique_ptr<Server>(new Server(std::move(state)));
  });
}

Result<std::vector<bool>> Server::wait(std::span<const int> fds, std::chrono::milliseconds at_most,
                                       const Answer& answer) {
  return caught(Code::internal, "control socket", [&]() -> Result<std::vector<bool>> {
    std::vector<zmq::pollitem_t> items;
    items.push_back({state_->control.handle(), 0, ZMQ_POLLIN, 0});
    items.push_back({state_->events.handle(), 0, ZMQ_POLLIN, 0});
    for (const int fd : fds) items.push_back({nullptr, fd, ZMQ_POLLIN, 0});
    // An interrupted poll is as good as a short one.
    static_cast<void>(
        zmq_poll(items.data(), static_cast<int>(items.size()), static_cast<long>(at_most.count())));

    for (int answered = 0; answered < kMostInARow; ++answered) {
      zmq::message_t sender;
      if (!state_->control.recv(sender, zmq::recv_flags::dontwait)) break;
      std::vector<zmq::message_t> parts;
      bool more = sender.more();
      while (more) {
        // Parts arrive together: none of them is waited for. All but the last few are thrown away.
        zmq::message_t part;
        static_cast<void>(state_->control.recv(part, zmq::recv_flags::none));
        more = part.more();
        if (parts.size() < 3) parts.push_back(std::move(part));
      }
      // {sender, request} of a DEALER; {sender, empty, request} of a REQ.
      const bool has_delimiter = parts.size() == 2 && parts[0].size() == 0;
      if (parts.size() != 1 && !has_delimiter) {
        ++state_->dropped;
        continue;
      }
      const std::string reply = answer(parts.back().to_string_view());
      const auto send = [&](zmq::message_t part, bool last) {
        const auto flags =
            last ? zmq::send_flags::dontwait : zmq::send_flags::dontwait | zmq::send_flags::sndmore;
        return state_->control.send(std::move(part), flags).has_value();
      };
      // The client may have gone meanwhile: EHOSTUNREACH, thrown.
      const auto sent = caught(Code::unavailable, "reply", [&] {
        return send(std::move(sender), false) &&
               (!has_delimiter || send(zmq::message_t(), false)) &&
               send(zmq::message_t(reply), true);
      });
      if (!sent || !*sent) ++state_->replies_lost;
    }
    // Subscriptions come in here and are of no interest.
    zmq::message_t subscription;
    while (state_->events.recv(subscription, zmq::recv_flags::dontwait)) {
    }

    std::vector<bool> readable;
    for (std::size_t i = 2; i < items.size(); ++i)
      readable.push_back((items[i].revents & ZMQ_POLLIN) != 0);
    return readable;
  });
}

void Server::publish(const EventLog::Published& event) {
  // XPUB drops for a reader that is full; nothing else can fail that anybody could mend.
  static_cast<void>(caught(Code::unavailable, "event", [&] {
    state_->events.send(zmq::message_t(event.topic),
                        zmq::send_flags::sndmore | zmq::send_flags::dontwait);
    state_->events.send(zmq::message_t(event.text), zmq::send_flags::dontwait);
  }));
}

std::uint64_t Server::dropped() const noexcept { return state_->dropped; }
std::uint64_t Server::replies_lost() const noexcept { return state_->replies_lost; }
std::string Server::control_endpoint() const {
  return state_->control.get(zmq::sockopt::last_endpoint);
}
std::string Server::event_endpoint() const {
  return state_->events.get(zmq::sockopt::last_endpoint);
}

}  // namespace alhazen

#include "tools/ctl_client.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <nlohmann/json.hpp>
#include <utility>
#include <zmq.hpp>

#include "alhazen/caught.h"
#include "daemon/control/message.h"

namespace alhazen::ctl {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

struct Client::State {
  zmq::context_t context{1};
  zmq::socket_t control{context, zmq::socket_type::dealer};
  zmq::socket_t events{context, zmq::socket_type::sub};
  std::string endpoint;
  milliseconds timeout{0};
  std::uint64_t asked = 0;
};

namespace {

/// ZeroMQ would wait for a socket that may come; a person wants to know that there is none.
Status look_for(const std::string& endpoint) {
  constexpr std::string_view kIpc = "ipc://";
  if (!endpoint.starts_with(kIpc)) return {};
  const std::string file = endpoint.substr(kIpc.size());
  struct stat about {};
  if (stat(file.c_str(), &about) != 0)
    return Error{Code::unavailable, errno == EACCES
                                        ? "you may not open " + file + "; ask for the group alhazen"
                                        : "no daemon listens at " + endpoint};
  // Connecting to a unix socket takes the right to write to it.
  if (access(file.c_str(), W_OK) != 0)
    return Error{Code::unavailable, "you may not open " + file + "; ask for the group alhazen"};
  return {};
}

Result<bool> wait(zmq::socket_t& socket, milliseconds at_most) {
  zmq::pollitem_t item{socket.handle(), 0, ZMQ_POLLIN, 0};
  const int ready = zmq_poll(&item, 1, static_cast<long>(at_most.count()));
  if (ready < 0 && errno != EINTR)
    return Error{Code::internal, std::string("poll: ") + zmq_strerror(errno)};
  return ready > 0;
}

}  // namespace

Client::Client(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
Client::Client(Client&&) noexcept = default;
Client& Client::operator=(Client&&) noexcept = default;
Client::~Client() = default;

Result<Client> Client::connect(const std::string& control_endpoint, milliseconds timeout) {
  ALHAZEN_TRY(look_for(control_endpoint));
  return caught(Code::unavailable, control_endpoint, [&]() -> Result<Client> {
    auto state = std::make_unique<State>();
    state->control.set(zmq::sockopt::linger, 0);
    state->events.set(zmq::sockopt::linger, 0);
    // Events are small and a terminal is slow: rather memory than a gap.
    state->events.set(zmq::sockopt::rcvhwm, 100'000);
    state->control.connect(control_endpoint);
    state->endpoint = control_endpoint;
    state->timeout = timeout;
    return Client(std::move(state));
  });
}

Result<json> Client::ask(std::string_view verb, const json& args, const std::string& idem) {
  Request request;
  request.id = "ctl-" + std::to_string(getpid()) + "-" + std::to_string(++state_->asked);
  request.verb = verb;
  request.args = std::make_shared<const json>(args);
  request.deadline_ms = state_->timeout.count();
  if (!idem.empty()) request.idem = idem;
  return caught(Code::corrupt, "answer", [&]() -> Result<json> {
    state_->control.send(zmq::buffer(to_text(request)), zmq::send_flags::none);
    const auto deadline = steady_clock::now() + state_->timeout;
    while (true) {
      const auto left = std::chrono::ceil<milliseconds>(deadline - steady_clock::now());
      if (left.count() <= 0)
        return Error{Code::timeout, "no answer from " + state_->endpoint + " within " +
                                        std::to_string(state_->timeout.count()) + " ms"};
      if (!ALHAZEN_TRY(wait(state_->control, left))) continue;
      zmq::message_t message;
      if (!state_->control.recv(message, zmq::recv_flags::dontwait)) continue;
      json reply = json::parse(message.to_string_view());
      // The late answer to a question that was given up.
      if (reply.at("id") != json(request.id)) continue;
      if (const auto error = reply.find("error"); error != reply.end())
        return error_from_json(*error);
      return reply.at("ok");
    }
  });
}

Status Client::subscribe(std::string endpoint) {
  if (endpoint.empty()) {
    const json hello = ALHAZEN_TRY(ask("hello", json::object()));
    endpoint = hello.value("event_endpoint", "");
  }
  ALHAZEN_TRY(look_for(endpoint));
  return caught(Code::unavailable, endpoint, [&] {
    state_->events.set(zmq::sockopt::subscribe, "");
    state_->events.connect(endpoint);
  });
}

Result<std::optional<Event>> Client::next_event(milliseconds at_most) {
  return caught(Code::corrupt, "event", [&]() -> Result<std::optional<Event>> {
    if (!ALHAZEN_TRY(wait(state_->events, at_most))) return std::optional<Event>();
    zmq::message_t topic, text;
    if (!state_->events.recv(topic, zmq::recv_flags::dontwait) || !topic.more() ||
        !state_->events.recv(text, zmq::recv_flags::dontwait))
      return std::optional<Event>();
    return std::optional<Event>({topic.to_string(), text.to_string()});
  });
}

}  // namespace alhazen::ctl

#include "daemon/service.h"

#include <signal.h>
#include <sys/signalfd.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace alhazen {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

Service::Service() {
  std::uint64_t timeout_us = 0;
  // A third of the time leaves room for one late turn of the loop.
  if (sd_watchdog_enabled(0, &timeout_us) > 0)
    feed_every_ = milliseconds(static_cast<std::int64_t>(timeout_us / 3000));
}

void Service::ready() { sd_notify(0, "READY=1"); }

void Service::status(const std::string& line) {
  if (line == said_) return;
  said_ = line;
  sd_notify(0, ("STATUS=" + line).c_str());
}

void Service::stopping() { sd_notify(0, "STOPPING=1"); }

void Service::feed() {
  const auto now = steady_clock::now();
  if (feed_every_.count() == 0 || now - fed_ < feed_every_ / 2) return;
  fed_ = now;
  sd_notify(0, "WATCHDOG=1");
}

Result<Signals> Signals::open() {
  sigset_t wanted;
  sigemptyset(&wanted);
  sigaddset(&wanted, SIGTERM);
  sigaddset(&wanted, SIGINT);
  pthread_sigmask(SIG_BLOCK, &wanted, nullptr);
  // A client or log reader that goes away is an error code, not the end of the daemon.
  signal(SIGPIPE, SIG_IGN);
  const int fd = signalfd(-1, &wanted, SFD_NONBLOCK | SFD_CLOEXEC);
  if (fd < 0) return Error{Code::unavailable, std::string("signalfd: ") + std::strerror(errno)};
  return Signals(fd);
}

Signals::Signals(Signals&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
Signals& Signals::operator=(Signals&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}
Signals::~Signals() {
  if (fd_ >= 0) close(fd_);
}

std::string Signals::take() const {
  signalfd_siginfo about{};
  if (read(fd_, &about, sizeof about) != static_cast<ssize_t>(sizeof about)) return "a signal";
  return about.ssi_signo == SIGTERM ? "SIGTERM" : about.ssi_signo == SIGINT ? "SIGINT" : "a signal";
}

}  // namespace alhazen

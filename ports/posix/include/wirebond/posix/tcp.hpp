// Connects to a TCP server, such as one that has a serial port: with a limited wait, and without small delays.
#pragma once

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/types.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <memory>
#include <string>

#include "wirebond/posix/descriptor.hpp"

namespace wirebond::posix {

/// The failed step and its number, for a sentence to the user.
struct TcpError {
  enum class Step : std::uint8_t { none, name, connect } step = Step::none;
  int code = 0;  ///< step name: of getaddrinfo; otherwise errno, ETIMEDOUT if there was no answer, ECANCELED
};

/// How long one address of the server may take to answer.
inline constexpr int tcp_answer_ms = 2000;

/// Send bytes at once, and detect a silently vanished peer within about 5 s.
inline void configure_tcp(int fd) {
  const auto set = [fd](int level, int name, int value) {
    static_cast<void>(::setsockopt(fd, level, name, &value, sizeof value));  // a system without it still works
  };
  set(IPPROTO_TCP, TCP_NODELAY, 1);
  set(SOL_SOCKET, SO_KEEPALIVE, 1);
  set(IPPROTO_TCP, TCP_KEEPIDLE, 2);
  set(IPPROTO_TCP, TCP_KEEPINTVL, 1);
  set(IPPROTO_TCP, TCP_KEEPCNT, 3);
  set(IPPROTO_TCP, TCP_USER_TIMEOUT, 5000);
}

/// Return 0, or why this address does not answer.
inline int connect_tcp(int fd, const sockaddr* address, socklen_t size, const std::atomic<bool>& cancelled) {
  constexpr int slice_ms = 50;  // between two checks of `cancelled`
  if (::connect(fd, address, size) == 0) return 0;
  if (errno != EINPROGRESS) return errno;
  for (int waited = 0; waited < tcp_answer_ms; waited += slice_ms) {
    if (cancelled.load()) return ECANCELED;
    struct pollfd waiting {
      fd, POLLOUT, 0
    };
    const int ready = ::poll(&waiting, 1, slice_ms);
    if (ready < 0 && errno != EINTR) return errno;
    if (ready <= 0) continue;
    int code = 0;
    socklen_t length = sizeof code;
    return ::getsockopt(fd, SOL_SOCKET, SO_ERROR, &code, &length) == 0 ? code : errno;
  }
  return ETIMEDOUT;
}

/// Open a non-blocking connection to `host`, a name or an address, at `port`. Waits for the name and for answers;
/// `cancelled` ends the latter within a moment. Returns an empty Descriptor and `error` on failure.
inline Descriptor open_tcp(const std::string& host, const std::string& port, const std::atomic<bool>& cancelled,
                           TcpError& error) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  const int answer = ::getaddrinfo(host.c_str(), port.c_str(), &hints, &list);
  if (answer != 0) {
    error = {TcpError::Step::name, answer};
    return {};
  }
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owned(list, &::freeaddrinfo);
  for (const addrinfo* at = list; at != nullptr; at = at->ai_next) {
    Descriptor fd(::socket(at->ai_family, at->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, at->ai_protocol));
    const int code = fd.is_open() ? connect_tcp(fd.get(), at->ai_addr, at->ai_addrlen, cancelled) : errno;
    if (code == 0) {
      configure_tcp(fd.get());
      return fd;
    }
    error = {TcpError::Step::connect, code};
    if (code == ECANCELED) break;
  }
  return {};
}

}  // namespace wirebond::posix

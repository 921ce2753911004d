/*
 * vcan-init: the first process of the guest that `with-vcan` boots.
 *
 * with-vcan starts User Mode Linux over the host's own files and names this program as its init.
 * It prepares the guest (mounts, CAN modules, vcan interfaces, multicast on lo, limits), starts the
 * caller's command with the caller's identity, directory and environment, and carries bytes and
 * signals between the two until the command ends. Then it reports the exit code and powers off.
 *
 * Input: the directory named by the environment variable WITH_VCAN_JOB (from the kernel command
 * line) holds three files of NUL-terminated records: `conf` (key=value), `argv` and `env`.
 *
 * Serial lines, all raw:
 *   ttyS0  out  the command's standard output
 *   ttyS1  out  the command's standard error
 *   ttyS2  in   orders from with-vcan, one byte each (see obey_order)
 *   ttyS3  out  news for with-vcan, one text line each: `ready`, `exit N`, `fail TEXT`
 *   ttyS4  in   the command's standard input, DLE-escaped (see unescape), if conf says stdin=1
 *
 * with-vcan sends nothing before it has read `ready`, because a line is not raw before it is open.
 */
// NOLINTBEGIN(clang-analyzer-security.insecureAPI.DeprecatedOrUnsafeBufferHandling): glibc lacks it
// NOLINTBEGIN(clang-analyzer-unix.Malloc): the job is kept for good
#define _GNU_SOURCE  // NOLINT(bugprone-reserved-identifier): this is glibc's name
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/mount.h>
#include <sys/reboot.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>

enum {
  kWrapperFailed = 125,
  kCannotExecute = 126,
  kNotFound = 127,
  kSignalled = 128,
  kLingerMs = 200,         /* what the command's leftover processes get between TERM and KILL */
  kOrderCloseStream = 0x80 /* an order of 0x80 + fd: nobody reads the command's fd any more */
};

/* The highest SCHED_FIFO priority, see sched(7). */
static const rlim_t kTopRealTimePriority = 99;
/* Holds some 21,900 CAN frames when asked for in full; the default of 212,992 holds 278. */
static const char kSocketBufferBytes[] = "8388608";

static int news_fd = STDERR_FILENO;

/* ---- ending ------------------------------------------------------------------------------- */

static _Noreturn void power_off(void) {
  sync();
  reboot(RB_POWER_OFF);
  for (;;) pause();
}

/* Tells with-vcan why the command could not be run, and ends the guest. */
__attribute__((format(printf, 1, 2))) static _Noreturn void fail(const char* format, ...) {
  char text[1024];
  va_list args;
  va_start(args, format);
  vsnprintf(text, sizeof text, format, args);
  va_end(args);
  for (char* c = text; *c; c++)
    if (*c == '\n') *c = ' ';
  dprintf(news_fd, "fail %s\n", text);
  tcdrain(news_fd);
  power_off();
}

/* ---- the job: what with-vcan asks for ---------------------------------------------------------
 */

struct job {
  char** argv;
  char** env;
  char** conf;
};

struct records {
  char** items; /* NULL-terminated */
  size_t count;
};

static void* allocate(size_t count, size_t size) {
  void* memory = calloc(count, size);
  if (!memory)
    fail("out of guest memory; expected room for %zu x %zu bytes; try a larger --mem", count, size);
  return memory;
}

/* Reads a whole file; the caller keeps the bytes for good. One NUL is appended. */
static char* read_file(const char* path, size_t* length) {
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  struct stat status;
  if (fd < 0 || fstat(fd, &status)) fail("cannot read %s: %s", path, strerror(errno));
  size_t size = (size_t)status.st_size;
  char* bytes = allocate(size + 1, 1);
  size_t have = 0;
  while (have < size) {
    ssize_t got = read(fd, bytes + have, size - have);
    if (got <= 0) fail("%s is shorter than its size of %zu bytes", path, size);
    have += (size_t)got;
  }
  close(fd);
  *length = size;
  return bytes;
}

static struct records read_records(const char* folder, const char* name) {
  char path[4096];
  snprintf(path, sizeof path, "%s/%s", folder, name);
  size_t length;
  char* bytes = read_file(path, &length);
  struct records records = {NULL, 0};
  for (size_t i = 0; i < length; i++) records.count += bytes[i] == '\0';
  records.items = allocate(records.count + 1, sizeof *records.items);
  char* next = bytes;
  for (size_t i = 0; i < records.count; i++) {
    records.items[i] = next;
    next += strlen(next) + 1;
  }
  return records;
}

static struct job read_job(void) {
  const char* folder = getenv("WITH_VCAN_JOB");
  if (!folder) fail("WITH_VCAN_JOB is not set; vcan-init is started by with-vcan, not by hand");
  struct job job = {
      .argv = read_records(folder, "argv").items,
      .env = read_records(folder, "env").items,
      .conf = read_records(folder, "conf").items,
  };
  return job;
}

/* Returns the value if `record` is `key=value`, else NULL. */
static char* value_of(char* record, const char* key) {
  size_t length = strlen(key);
  return strncmp(record, key, length) == 0 && record[length] == '=' ? record + length + 1 : NULL;
}

/* Returns the first value of `key`, or NULL. */
static char* conf_text(const struct job* job, const char* key) {
  for (char** record = job->conf; *record; record++) {
    char* value = value_of(*record, key);
    if (value) return value;
  }
  return NULL;
}

static unsigned conf_number(const struct job* job, const char* key) {
  const char* text = conf_text(job, key);
  return text ? (unsigned)strtoul(text, NULL, 10) : 0;
}

/* ---- the guest: mounts, modules, interfaces, limits
 * ---------------------------------------------- */

static void mount_at(const char* type, const char* where, unsigned long flags,
                     const char* options) {
  mkdir(where, 0755);
  if (mount(type, where, type, flags, options) && errno != EBUSY)
    fail("cannot mount %s on %s: %s", type, where, strerror(errno));
}

static void mount_all(void) {
  mount_at("proc", "/proc", MS_NOSUID | MS_NODEV | MS_NOEXEC, "");
  mount_at("sysfs", "/sys", MS_NOSUID | MS_NODEV | MS_NOEXEC, "");
  mount_at("devtmpfs", "/dev", MS_NOSUID, "");
  mount_at("devpts", "/dev/pts", MS_NOSUID | MS_NOEXEC, "mode=620,ptmxmode=666");
  mount_at("tmpfs", "/dev/shm", MS_NOSUID | MS_NODEV, "mode=1777");
  mount_at("mqueue", "/dev/mqueue", MS_NOSUID | MS_NODEV | MS_NOEXEC, "");
  mount_at("tmpfs", "/run", MS_NOSUID | MS_NODEV, "mode=755");
}

static void make_link(const char* target, const char* path) {
  if (symlink(target, path) && errno != EEXIST)
    fail("cannot make the link %s: %s", path, strerror(errno));
}

static void make_device_links(void) {
  make_link("/proc/self/fd", "/dev/fd");
  make_link("/proc/self/fd/0", "/dev/stdin");
  make_link("/proc/self/fd/1", "/dev/stdout");
  make_link("/proc/self/fd/2", "/dev/stderr");
  chmod("/dev/ptmx", 0666);
}

static void load_module(const char* path) {
  int fd = open(path, O_RDONLY | O_CLOEXEC);
  if (fd < 0 || (syscall(SYS_finit_module, fd, "", 0) && errno != EEXIST))
    fail("cannot load the guest module %s: %s", path, strerror(errno));
  close(fd);
}

static void bring_up(const char* interface, short more_flags) {
  int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  struct ifreq request = {0};
  strncpy(request.ifr_name, interface, IFNAMSIZ - 1);
  bool known = fd >= 0 && ioctl(fd, SIOCGIFFLAGS, &request) == 0;
  request.ifr_flags |= (short)(IFF_UP | more_flags);
  if (!known || ioctl(fd, SIOCSIFFLAGS, &request))
    fail("cannot bring up %s: %s", interface, strerror(errno));
  close(fd);
}

struct link_request {
  struct nlmsghdr header;
  struct ifinfomsg info;
  char attributes[256];
};

/* Appends an attribute and returns it, so that a nest can be given its length later. */
static struct rtattr* add_attribute(struct link_request* request, unsigned short type,
                                    const void* data, size_t size) {
  struct rtattr* attribute = (void*)((char*)request + NLMSG_ALIGN(request->header.nlmsg_len));
  attribute->rta_type = type;
  attribute->rta_len = (unsigned short)RTA_LENGTH(size);
  if (size) memcpy(RTA_DATA(attribute), data, size);
  request->header.nlmsg_len =
      NLMSG_ALIGN(request->header.nlmsg_len) + RTA_ALIGN(attribute->rta_len);
  return attribute;
}

/* Sends one netlink request and returns the kernel's errno for it, 0 if it was done. */
static int netlink_error(const struct link_request* request) {
  struct {
    struct nlmsghdr header;
    struct nlmsgerr body;
    char rest[512];
  } reply = {0};
  int fd = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
  bool answered = fd >= 0 && send(fd, request, request->header.nlmsg_len, 0) > 0 &&
                  recv(fd, &reply, sizeof reply, 0) >= (ssize_t)NLMSG_LENGTH(sizeof reply.body);
  int error = answered ? -reply.body.error : errno;
  if (fd >= 0) close(fd);
  return error;
}

/* The same as `ip link add NAME type vcan && ip link set NAME up`. */
static void add_vcan(const char* name) {
  struct link_request request = {0};
  request.header.nlmsg_len = NLMSG_LENGTH(sizeof request.info);
  request.header.nlmsg_type = RTM_NEWLINK;
  request.header.nlmsg_flags = NLM_F_REQUEST | NLM_F_CREATE | NLM_F_EXCL | NLM_F_ACK;
  add_attribute(&request, IFLA_IFNAME, name, strlen(name) + 1);
  struct rtattr* nest = add_attribute(&request, IFLA_LINKINFO, NULL, 0);
  add_attribute(&request, IFLA_INFO_KIND, "vcan", strlen("vcan"));
  nest->rta_len = (unsigned short)((char*)&request + request.header.nlmsg_len - (char*)nest);
  int error = netlink_error(&request);
  if (error) fail("cannot add the vcan interface %s: %s", name, strerror(error));
  bring_up(name, 0);
}

/* The same as `ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo`. */
static void enable_loopback_multicast(void) {
  bring_up("lo", IFF_MULTICAST);
  struct sockaddr_in group = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(0xe0000000)};
  struct sockaddr_in mask = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(0xf0000000)};
  char device[] = "lo";
  struct rtentry route = {.rt_flags = RTF_UP, .rt_dev = device};
  memcpy(&route.rt_dst, &group, sizeof group);
  memcpy(&route.rt_genmask, &mask, sizeof mask);
  int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0 || (ioctl(fd, SIOCADDRT, &route) && errno != EEXIST))
    fail("cannot route 224.0.0.0/4 to lo: %s", strerror(errno));
  close(fd);
}

static void write_setting(const char* path, const char* value) {
  int fd = open(path, O_WRONLY | O_CLOEXEC);
  if (fd < 0 || write(fd, value, strlen(value)) < 0)
    fail("cannot set %s to %s: %s", path, value, strerror(errno));
  close(fd);
}

static void raise_limits(void) {
  const struct rlimit files = {1024, 1 << 20};
  const struct rlimit locked = {RLIM_INFINITY, RLIM_INFINITY};
  const struct rlimit priority = {kTopRealTimePriority, kTopRealTimePriority};
  setrlimit(RLIMIT_NOFILE, &files);
  setrlimit(RLIMIT_MEMLOCK, &locked);
  setrlimit(RLIMIT_RTPRIO, &priority);
  write_setting("/proc/sys/net/core/rmem_max", kSocketBufferBytes);
  write_setting("/proc/sys/net/core/wmem_max", kSocketBufferBytes);
}

static void prepare_guest(const struct job* job) {
  const char* hostname = conf_text(job, "hostname");
  if (hostname) sethostname(hostname, strlen(hostname));
  for (char** record = job->conf; *record; record++) {
    const char* module = value_of(*record, "module");
    if (module) load_module(module);
  }
  enable_loopback_multicast();
  for (char** record = job->conf; *record; record++) {
    const char* interface = value_of(*record, "iface");
    if (interface) add_vcan(interface);
  }
  raise_limits();
}

/* ---- the command ------------------------------------------------------------------------------
 */

struct command {
  pid_t pid; /* also its process group and session */
  int stdin_fd;
  int stdout_fd;
  int stderr_fd;
};

static void take_identity(const struct job* job) {
  gid_t groups[256];
  size_t count = 0;
  for (char** record = job->conf; *record && count < sizeof groups / sizeof *groups; record++) {
    const char* group = value_of(*record, "group");
    if (group) groups[count++] = (gid_t)strtoul(group, NULL, 10);
  }
  gid_t gid = conf_number(job, "gid");
  uid_t uid = conf_number(job, "uid");
  if (setgroups(count, groups) || setgid(gid) || setuid(uid)) {
    dprintf(STDERR_FILENO, "with-vcan: cannot become uid %u, gid %u inside: %s\n", uid, gid,
            strerror(errno));
    _exit(kWrapperFailed);
  }
}

static void enter_directory(const char* path) {
  if (chdir(path) == 0) return;
  dprintf(
      STDERR_FILENO,
      "with-vcan: cannot enter the current directory %s inside the guest: %s; expected a directory"
      " on the host's disks, because /dev, /proc, /run and /sys are the guest's own\n",
      path, strerror(errno));
  _exit(kWrapperFailed);
}

static void reset_signals(void) {
  for (int number = 1; number < NSIG; number++) signal(number, SIG_DFL);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, NULL);
}

/* Runs in the child: becomes the caller's command. */
static _Noreturn void execute(const struct job* job, int in, int out, int err) {
  dup2(in, STDIN_FILENO);
  dup2(out, STDOUT_FILENO);
  dup2(err, STDERR_FILENO);
  setsid();
  reset_signals();
  take_identity(job);
  enter_directory(conf_text(job, "cwd"));
  umask(conf_number(job, "umask"));
  environ = job->env;
  execvp(job->argv[0], job->argv);
  int error = errno;
  dprintf(STDERR_FILENO, "with-vcan: %s: %s\n", job->argv[0],
          error == ENOENT ? "command not found" : strerror(error));
  _exit(error == ENOENT ? kNotFound : kCannotExecute);
}

static void make_pipe(int ends[2]) {
  if (pipe2(ends, O_CLOEXEC)) fail("cannot make a pipe: %s", strerror(errno));
}

static void set_nonblocking(int fd) { fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK); }

static struct command start_command(const struct job* job) {
  int in[2] = {-1, -1};
  int out[2];
  int err[2];
  if (conf_number(job, "stdin")) {
    make_pipe(in);
    set_nonblocking(in[1]);
  } else {
    in[0] = open("/dev/null", O_RDONLY | O_CLOEXEC);
  }
  make_pipe(out);
  make_pipe(err);
  pid_t pid = fork();
  if (pid < 0) fail("cannot fork: %s", strerror(errno));
  if (pid == 0) execute(job, in[0], out[1], err[1]);
  close(in[0]);
  close(out[1]);
  close(err[1]);
  struct command command = {pid, in[1], out[0], err[0]};
  return command;
}

/* ---- carrying bytes ---------------------------------------------------------------------------
 */

/* Moves bytes from one descriptor to another without ever blocking on either. */
struct pump {
  int from;     /* -1: at its end */
  int to;       /* -1: nobody takes the bytes; they are thrown away */
  bool escaped; /* the source is DLE-escaped and `to` is closed at its end */
  bool in_escape;
  size_t begin; /* bytes[begin, end) are still to be written */
  size_t end;
  char bytes[65536];
};

static void connect_pump(struct pump* pump, int from, int to) {
  pump->from = from;
  pump->to = to;
}

static void close_fd(int* fd) {
  if (*fd >= 0) close(*fd);
  *fd = -1;
}

static bool holds_bytes(const struct pump* pump) { return pump->begin < pump->end; }

static bool is_finished(const struct pump* pump) { return pump->from < 0 && !holds_bytes(pump); }

/*
 * Standard input on a serial line has no end of file, so with-vcan sends DLE DLE for a DLE (0x10)
 * and DLE EOT (0x04) for the end. Unescapes the pump's bytes in place and closes `from` at the end.
 */
static void unescape(struct pump* pump) {
  enum { kEot = 0x04, kDle = 0x10 };
  size_t kept = 0;
  for (size_t i = 0; i < pump->end && pump->from >= 0; i++) {
    char byte = pump->bytes[i];
    if (!pump->in_escape && byte == kDle) {
      pump->in_escape = true;
      continue;
    }
    if (pump->in_escape && byte == kEot)
      close_fd(&pump->from);
    else
      pump->bytes[kept++] = byte;
    pump->in_escape = false;
  }
  pump->end = kept;
}

static void fill(struct pump* pump) {
  ssize_t got = read(pump->from, pump->bytes, sizeof pump->bytes);
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (got <= 0) {
    close_fd(&pump->from);
    return;
  }
  pump->begin = 0;
  pump->end = (size_t)got;
  if (pump->escaped) unescape(pump);
}

static void drain(struct pump* pump) {
  ssize_t put = -1;
  if (pump->to >= 0) put = write(pump->to, pump->bytes + pump->begin, pump->end - pump->begin);
  if (put >= 0) {
    pump->begin += (size_t)put;
  } else if (pump->to < 0 || (errno != EAGAIN && errno != EINTR)) {
    pump->begin = pump->end;
    if (pump->escaped) close_fd(&pump->to); /* the command closed its standard input */
  }
}

/* Fills the two poll slots of a pump: it reads only when it holds nothing, so nothing can be lost.
 */
static void await(const struct pump* pump, struct pollfd slots[2]) {
  slots[0] = (struct pollfd){holds_bytes(pump) ? -1 : pump->from, POLLIN, 0};
  slots[1] = (struct pollfd){holds_bytes(pump) ? pump->to : -1, POLLOUT, 0};
}

static void advance(struct pump* pump, const struct pollfd slots[2]) {
  if (slots[0].revents) fill(pump);
  if (slots[1].revents || (holds_bytes(pump) && pump->to < 0)) drain(pump);
  if (pump->escaped && is_finished(pump)) close_fd(&pump->to);
}

/* ---- serial lines -----------------------------------------------------------------------------
 */

struct lines {
  int out;
  int err;
  int orders;
  int in; /* -1 without standard input */
};

static int open_line(const char* path) {
  int fd = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
  struct termios settings;
  if (fd < 0 || tcgetattr(fd, &settings))
    fail("cannot open the serial line %s: %s", path, strerror(errno));
  cfmakeraw(&settings);
  if (tcsetattr(fd, TCSANOW, &settings))
    fail("cannot make the serial line %s raw: %s", path, strerror(errno));
  return fd;
}

static struct lines open_lines(const struct job* job) {
  struct lines lines = {
      .out = open_line("/dev/ttyS0"),
      .err = open_line("/dev/ttyS1"),
      .orders = open_line("/dev/ttyS2"),
      .in = conf_number(job, "stdin") ? open_line("/dev/ttyS4") : -1,
  };
  set_nonblocking(lines.out);
  set_nonblocking(lines.err);
  set_nonblocking(lines.orders);
  if (lines.in >= 0) set_nonblocking(lines.in);
  return lines;
}

/* ---- supervision ------------------------------------------------------------------------------
 */

enum { kIn, kOut, kErr, kPumpCount };

struct supervision {
  struct command command;
  struct lines lines;
  struct pump* pumps;
  int children_fd; /* signalfd of SIGCHLD */
  bool command_ended;
  bool all_ended; /* no process is left besides this one */
  int exit_code;
  int64_t kill_at_ms; /* when leftover processes are killed; 0: not yet or no more */
};

static int64_t now_ms(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

/* Blocks SIGCHLD before anything is forked, so that no end can be missed. */
static int watch_children(void) {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGCHLD);
  sigprocmask(SIG_BLOCK, &set, NULL);
  signal(SIGPIPE, SIG_IGN);
  int fd = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
  if (fd < 0) fail("cannot watch for ended processes: %s", strerror(errno));
  return fd;
}

static int exit_code_of(int status) {
  return WIFEXITED(status) ? WEXITSTATUS(status) : kSignalled + WTERMSIG(status);
}

/* The command has ended: what it left running is asked to stop, and killed a little later. */
static void end_leftovers(struct supervision* supervision) {
  if (kill(-1, SIGTERM) == 0) supervision->kill_at_ms = now_ms() + kLingerMs;
}

static void reap(struct supervision* supervision) {
  struct signalfd_siginfo discarded;
  while (read(supervision->children_fd, &discarded, sizeof discarded) > 0) {
  }
  int status;
  pid_t pid;
  while ((pid = waitpid(-1, &status, WNOHANG)) > 0) {
    if (pid != supervision->command.pid) continue;
    supervision->command_ended = true;
    supervision->exit_code = exit_code_of(status);
    end_leftovers(supervision);
  }
  supervision->all_ended = pid < 0 && errno == ECHILD;
}

/* Signals the command's process group, or the command alone while it has not yet made the group. */
static void signal_command(pid_t pid, int number) {
  if (kill(-pid, number)) kill(pid, number);
}

/* An order is a signal number for the command's process group, or 0x80 + fd: close that stream. */
static void obey_order(struct supervision* supervision, unsigned char order) {
  if (order == kOrderCloseStream + STDOUT_FILENO)
    close_fd(&supervision->pumps[kOut].from);
  else if (order == kOrderCloseStream + STDERR_FILENO)
    close_fd(&supervision->pumps[kErr].from);
  else if (order > 0 && order < NSIG && !supervision->command_ended)
    signal_command(supervision->command.pid, order);
}

static void read_orders(struct supervision* supervision) {
  unsigned char orders[64];
  ssize_t count = read(supervision->lines.orders, orders, sizeof orders);
  if (count == 0 || (count < 0 && errno != EAGAIN && errno != EINTR))
    close_fd(&supervision->lines.orders);
  for (ssize_t i = 0; i < count; i++) obey_order(supervision, orders[i]);
}

static bool is_over(const struct supervision* supervision) {
  return supervision->command_ended && supervision->all_ended &&
         is_finished(&supervision->pumps[kOut]) && is_finished(&supervision->pumps[kErr]);
}

static int poll_timeout_ms(const struct supervision* supervision) {
  if (!supervision->kill_at_ms) return -1;
  int64_t left = supervision->kill_at_ms - now_ms();
  return left > 0 ? (int)left : 0;
}

/* One round: waits for something to happen and deals with it. */
static void supervise_once(struct supervision* supervision) {
  struct pollfd slots[2 * kPumpCount + 2];
  for (size_t i = 0; i < kPumpCount; i++) await(&supervision->pumps[i], &slots[2 * i]);
  struct pollfd* orders = &slots[(size_t)2 * kPumpCount];
  struct pollfd* children = orders + 1;
  *orders = (struct pollfd){supervision->lines.orders, POLLIN, 0};
  *children = (struct pollfd){supervision->children_fd, POLLIN, 0};

  if (poll(slots, sizeof slots / sizeof *slots, poll_timeout_ms(supervision)) < 0) return;
  if (orders->revents) read_orders(supervision);
  for (size_t i = 0; i < kPumpCount; i++) advance(&supervision->pumps[i], &slots[2 * i]);
  if (children->revents) reap(supervision);
  if (supervision->kill_at_ms && now_ms() >= supervision->kill_at_ms) {
    kill(-1, SIGKILL);
    supervision->kill_at_ms = 0;
  }
}

static int supervise(const struct job* job, struct lines lines) {
  static struct pump pumps[kPumpCount];
  int children_fd = watch_children();
  dprintf(news_fd, "ready\n");
  struct command command = start_command(job);
  connect_pump(&pumps[kIn], lines.in, command.stdin_fd);
  connect_pump(&pumps[kOut], command.stdout_fd, lines.out);
  connect_pump(&pumps[kErr], command.stderr_fd, lines.err);
  pumps[kIn].escaped = true;
  struct supervision supervision = {
      .command = command, .lines = lines, .pumps = pumps, .children_fd = children_fd};
  while (!is_over(&supervision)) supervise_once(&supervision);
  return supervision.exit_code;
}

int main(void) {
  if (getpid() != 1) {
    fprintf(stderr,
            "vcan-init: started as process %d, expected 1: with-vcan boots it as the init of its "
            "guest\n",
            (int)getpid());
    return kWrapperFailed;
  }
  mount_all();
  make_device_links();
  news_fd = open_line("/dev/ttyS3");
  struct job job = read_job();
  struct lines lines = open_lines(&job);
  prepare_guest(&job);
  int exit_code = supervise(&job, lines);
  tcdrain(lines.out);
  tcdrain(lines.err);
  dprintf(news_fd, "exit %d\n", exit_code);
  tcdrain(news_fd);
  power_off();
}
// NOLINTEND(clang-analyzer-unix.Malloc)
// NOLINTEND(clang-analyzer-security.insecureAPI.DeprecatedOrUnsafeBufferHandling)

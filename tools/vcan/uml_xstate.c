/* Lets User Mode Linux run on processors whose extended state is larger than it knows.
 *
 * UML (6.1) sets its processes' vector registers with a buffer of 2696 bytes, all of AVX-512 and
 * the protection keys. A host whose processor has more (AMX: 11,008 bytes) refuses a buffer that is
 * not whole with EFAULT, and UML panics: "ptrace set fp regs failed, errno = 14". Preloaded into
 * linux.uml, this hands over a whole one, with the features that UML knows nothing of in their
 * initial state. On other hosts it changes nothing. UML reads with a short buffer, too, which hosts
 * allow.
 */
#define _GNU_SOURCE
#include <cpuid.h>
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

#define XSTATE_BV_OFFSET 512 /* of the header's bit per feature: Intel SDM 1, 13.4.2 */
#define FIRST_EXTENDED_FEATURE 2
#define XSAVE_LEAF 0xd
#define LARGEST_XSTATE 65536

typedef long (*ptrace_function)(enum __ptrace_request request, ...);

static void* xstate_set(void) { return (void*)(uintptr_t)NT_X86_XSTATE; }

/* Bits of the features that lie within the first `length` bytes of a standard XSAVE area. */
static uint64_t features_within(size_t length) {
  uint64_t features = 3; /* x87, SSE: the legacy area */
  for (unsigned feature = FIRST_EXTENDED_FEATURE; feature < 63; ++feature) {
    unsigned size = 0, offset = 0, flags = 0, unused = 0;
    if (!__get_cpuid_count(XSAVE_LEAF, feature, &size, &offset, &flags, &unused)) continue;
    const int is_user = (flags & 1U) == 0;
    if (is_user && size > 0 && (size_t)offset + size <= length) features |= UINT64_C(1) << feature;
  }
  return features;
}

/* The given state in a whole area. The rest of it is in its initial state, for UML never asks for
 * what it does not know: one call, as on other hosts, for UML makes it at every switch to a
 * process. */
static long set_whole_xstate(ptrace_function next, pid_t pid, const struct iovec* given) {
  static unsigned char whole[LARGEST_XSTATE]; /* UML's kernel is one thread */
  static size_t length;                       /* of the host's area; 0: not known yet */
  static uint64_t features;
  struct iovec area = {whole, sizeof whole};
  if (length == 0) {
    if (next(PTRACE_GETREGSET, pid, xstate_set(), &area) != 0) return -1;
    memset(whole, 0, sizeof whole);
    length = area.iov_len;
    features = features_within(given->iov_len);
  }
  if (given->iov_len >= length || given->iov_len < XSTATE_BV_OFFSET + sizeof(uint64_t)) {
    errno = EFAULT;
    return -1;
  }
  memcpy(whole, given->iov_base, given->iov_len);
  uint64_t present;
  memcpy(&present, whole + XSTATE_BV_OFFSET, sizeof present);
  present &= features;
  memcpy(whole + XSTATE_BV_OFFSET, &present, sizeof present);
  area.iov_len = length;
  return next(PTRACE_SETREGSET, pid, xstate_set(), &area);
}

long ptrace(enum __ptrace_request request, ...) {
  static ptrace_function next;
  static int needs_whole; /* the host has refused a short area once */
  if (next == NULL) *(void**)&next = dlsym(RTLD_NEXT, "ptrace"); /* as POSIX has it */
  va_list arguments;
  va_start(arguments, request);
  const pid_t pid = va_arg(arguments, pid_t);
  void* const address = va_arg(arguments, void*);
  void* const data = va_arg(arguments, void*);
  va_end(arguments);
  const int sets_xstate = request == PTRACE_SETREGSET && address == xstate_set();
  if (sets_xstate && needs_whole) return set_whole_xstate(next, pid, data);
  const long answer = next(request, pid, address, data);
  if (answer == -1 && errno == EFAULT && sets_xstate) {
    needs_whole = 1;
    return set_whole_xstate(next, pid, data);
  }
  return answer;
}

/* Stands in for CPython's own pyconfig.h of Windows and of macOS: what the stable interface (Py_LIMITED_API) reads of
   it. The compiler for each of them knows the sizes. setup/foreign_python.py puts it beside the other headers. */
#ifndef Py_PYCONFIG_H
#define Py_PYCONFIG_H

#include <stdio.h> /* as that of Windows does; nanobind relies on it */

#define SIZEOF_INT __SIZEOF_INT__
#define SIZEOF_LONG __SIZEOF_LONG__
#define SIZEOF_LONG_LONG __SIZEOF_LONG_LONG__
#define SIZEOF_SIZE_T __SIZEOF_SIZE_T__
#define SIZEOF_VOID_P __SIZEOF_POINTER__
#define SIZEOF_UINTPTR_T __SIZEOF_POINTER__
#define SIZEOF_WCHAR_T __SIZEOF_WCHAR_T__
#define HAVE_WCHAR_H 1
#define WITH_THREAD 1

#ifdef _WIN32
#define MS_WINDOWS 1
#define MS_WIN32 1
#define MS_WIN64 1
#define NT_THREADS 1
#define SIZEOF_PID_T __SIZEOF_INT__
/* Everything of Python is imported from python3.dll. */
#define Py_ENABLE_SHARED 1
#define HAVE_DECLSPEC_DLL 1
#else
#define HAVE_SSIZE_T 1
#define SIZEOF_PID_T __SIZEOF_INT__
#endif

#endif

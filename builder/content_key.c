#include "content_key.h"

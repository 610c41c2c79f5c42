"""Counts with their nouns, as messages, reports and tables write them."""


def counted(count: int, noun: str, form: str = '') -> str:
    """
    Return a count, formatted as `form` says, with its noun in singular or plural.

    Examples
    --------
    >>> counted(1, 'stretch'), counted(2, 'stretch'), counted(1000, 'message', ',')
    ('1 stretch', '2 stretches', '1,000 messages')
    """
    plural = '' if count == 1 else 'es' if noun.endswith(('ch', 's')) else 's'
    return f'{count:{form}} {noun}{plural}'
